"""The paper's experiment as the command line can change it."""

from dataclasses import dataclass

from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.suites import PAPER_METHODS, paper_sweep
from deqmcl_gym.validation import InputError, integer
from localizers import names, resolve


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What ``paper``, ``run`` and ``phase`` share; checked before anything is run or written."""

    scenario: str = "paper"
    localizers: tuple[str, ...] = PAPER_METHODS
    trials: int = 10
    seed: int = 0
    particles: int = 1000
    lag: int = 20

    def __post_init__(self) -> None:
        if not self.localizers:
            raise InputError(f"no localizer is named: allowed are {', '.join(names())}.")
        for name in self.localizers:
            resolve(name)
        if len(set(self.localizers)) < len(self.localizers):
            raise InputError(f"a localizer is named twice in {', '.join(self.localizers)}.")
        integer("--trials", self.trials, low=1, high=100_000)
        integer("--seed", self.seed)
        integer("--particles", self.particles, low=1)
        integer("--lag", self.lag)

    @property
    def sweep(self) -> Sweep:
        """All localizers on the same worlds."""
        return paper_sweep(
            scenario=self.scenario,
            localizers=self.localizers,
            trials=self.trials,
            seed=self.seed,
            lag=self.lag,
            particles=self.particles,
        )

    @property
    def words(self) -> str:
        """N, L and seed."""
        return f"N = {self.particles}, L = {self.lag}, seed {self.seed}"
