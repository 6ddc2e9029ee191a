"""The named experiments: the sweep files of this folder, by name; and the paper's, with options."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.setup.names import scenario_names
from benchmarks.setup.overrides import Overrides
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.sweepfile import read_sweep, suite_file, suite_names, with_localizers
from benchmarks.trials.spec import Method

SUITES = tuple(suite_names())
PAPER_METHODS = ("mcl", "mcl-smoother", "mcl-map", "mcl-map-smoother", "deq-mcl", "dead-reckoning")


def sweep_named(name: str, added: Sequence[str] = ()) -> Sweep:
    """Return the sweep of a suite, a scenario or a path in .toml, with further localizers.

    A scenario has the methods of the paper.
    """
    if name.endswith(".toml"):
        return read_sweep(Path(name), added)
    if name in scenario_names() and name not in SUITES:
        sweep = Sweep(title=name, scenario=name, localizers=tuple(map(Method, PAPER_METHODS)))
    else:
        sweep = read_sweep(suite_file("suite or scenario", name, scenario_names()))
    return with_localizers(sweep, added)


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
