"""The named experiments: the sweep files of this folder, by name; and the paper's, with options."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.setup.overrides import Overrides
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


def sweep_named(name: str, added: Sequence[str] = ()) -> Sweep:
    """Return the sweep of a suite, or of a path that ends in .toml, with further localizers."""
    if name.endswith(".toml"):
        return read_sweep(Path(name), added)
    suite_file("suite", name)  # refuses others
    return with_localizers(SUITES[name], added)


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
    """Return the paper's experiment: all methods on the same worlds of one scenario."""
    return Sweep(
        title="The paper's experiment",
        scenario=scenario,
        localizers=tuple(Method(name=name) for name in localizers),
        trials=trials,
        seed=seed,
        lag=lag,
        params=Overrides(params),
    )


def paper_suite(**given: Any) -> list[Trial]:
    """Return the trials of ``paper_sweep``, which takes the same arguments."""
    return paper_sweep(**given).distinct()
