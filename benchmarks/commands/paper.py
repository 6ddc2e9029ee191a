"""``deqmcl paper``."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.commands.shared import add_setting, comma_separated

NAME = "paper"
HELP = "run the paper's experiment: Table 1 and figures"
DESCRIPTION = (
    "Run the paper's experiment: all methods on the same worlds; what the output folder already "
    "holds is not run again."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_setting(parser)
    parser.add_argument("--trials", type=int, default=10, metavar="K", help="worlds (10)")
    parser.add_argument(
        "--localizers", metavar="A,B,…", help="methods, comma-separated (the paper's and baselines)"
    )
    parser.add_argument("--jobs", type=int, metavar="J", help="processes (one per processor)")
    parser.add_argument(
        "--out", type=Path, default=Path("results/paper"), metavar="DIR", help="(results/paper)"
    )


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.engines import available_cpus
    from benchmarks.experiment import Experiment
    from benchmarks.paper import run_paper
    from benchmarks.sweeps.suites import PAPER_METHODS

    named = options.localizers
    experiment = Experiment(
        scenario=options.scenario,
        localizers=PAPER_METHODS if named is None else comma_separated(named),
        trials=options.trials,
        seed=options.seed,
        particles=options.particles,
        lag=options.lag,
    )
    jobs = available_cpus() if options.jobs is None else options.jobs
    return run_paper(experiment, options.out, jobs=jobs, command=["deqmcl", *given])
