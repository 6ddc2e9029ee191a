"""The named experiments: the sweep files of this folder, by name; and the paper's, with options."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

from msgspec import Struct, convert

from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.sweepfile import read_sweep, suite_file, suite_names, with_localizers
from benchmarks.trials.spec import Method, Trial


class _Suites(Mapping[str, Sweep]):
    """Sweeps by name, each read when it is asked for."""

    _names = suite_names()

    def __getitem__(self, name: str) -> Sweep:
        if name not in self._names:
            raise KeyError(name)
        return _suite(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@cache
def _suite(name: str) -> Sweep:
    return read_sweep(suite_file("suite", name))


SUITES: Mapping[str, Sweep] = _Suites()
# suites that are run one after the other under one name
FAMILIES = {"study": tuple(name for name in SUITES if name.startswith("study-"))}
TIMES = Path(__file__).with_name("times.csv")


class Time(Struct, frozen=True):
    """How long a suite takes on two cores: that of a run, or as one trial of its cells tells.

    Attributes:
        minutes: of all its trials.
        trials: how many it had then.
        by: "run" or "trials".
    """

    minutes: float
    trials: int
    by: Literal["run", "trials"]


def times() -> dict[str, Time]:
    """Return the times of the suites that were measured; ``make reports`` adds those of runs."""
    with TIMES.open(newline="", encoding="utf-8") as file:
        return {row.pop("suite"): convert(row, Time, strict=False) for row in csv.DictReader(file)}


def minutes(name: str) -> float | None:
    """Return about how long a suite or a family takes on two cores; None: it was not measured."""
    if name in FAMILIES:
        parts = [minutes(own) for own in FAMILIES[name]]
        return None if None in parts else sum(filter(None, parts))
    time = times().get(name)
    return None if time is None else time.minutes * SUITES[name].planned / time.trials


def in_words(minutes: float | None) -> str:
    """Say how long something takes."""
    if minutes is None:
        return "never timed"
    return f"about {minutes:.0f} min" if minutes >= 1 else "less than 1 min"


def sweeps_named(name: str, added: Sequence[str] = ()) -> dict[str, Sweep]:
    """Return the sweeps of a name by their folder within --out: one, or those of a family.

    Args:
        name: of a suite, a family or a file that ends in .toml.
        added: localizers to add.

    Raises:
        InputError: there is no such suite, family or file, or no localizer of an added name.
    """
    if name in FAMILIES:
        return {own: with_localizers(SUITES[own], added) for own in FAMILIES[name]}
    if name.endswith(".toml"):
        return {"": read_sweep(Path(name), added)}
    suite_file("suite", name, tuple(FAMILIES))
    return {"": with_localizers(SUITES[name], added)}


PAPER_METHODS = ("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl", "dead-reckoning")


def paper_sweep(
    *,
    scenario: str = "paper",
    localizers: Sequence[str] = PAPER_METHODS,
    trials: int = 10,
    seed: int = 0,
    lag: int = 20,
    **params: Any,
) -> Sweep:
    """Return the paper's experiment: all methods on the same worlds of one scenario.

    Args:
        scenario: name of the world.
        localizers: names; each gets those of ``params`` (and ``lag``) that it has a use for.
        trials: number of worlds.
        seed: root of all randomness.
        lag: the lag L.
        params: of the localizers.
    """
    return Sweep(
        title="The paper's experiment",
        scenario=scenario,
        localizers=tuple(Method(name=name) for name in localizers),
        trials=trials,
        seed=seed,
        lag=lag,
        params=Changes(params),
    )


def paper_suite(**given: Any) -> list[Trial]:
    """Return the trials of ``paper_sweep``, which takes the same arguments."""
    return paper_sweep(**given).distinct()
