"""``deqmcl run``."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.commands.shared import add_setting, sweep_of
from benchmarks.console import doing

NAME = "run"
HELP = "run one lap: animation, error curve, trace"
DESCRIPTION = (
    "Run one lap of one localizer: its animation, its error curve, and its trace as npz and as TUM "
    "trajectory files (for evo)."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_setting(parser)
    parser.add_argument("--localizer", required=True, metavar="NAME", help="the method")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="output folder")


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    del given
    from benchmarks.pictures.lap import run_lap
    from localizers.naming.registry import complete

    (trial,) = sweep_of(options, (complete(options.localizer),)).distinct()
    with doing(f"running and drawing a lap of {trial.localizer}"):
        return run_lap(trial, options.out)
