"""``deqmcl run``."""

import argparse
from collections.abc import Sequence

from benchmarks.commands.shared import add_params, add_setting, file, folder, params_named, sweep_of
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
    add_params(parser)
    parser.add_argument(
        "--log",
        type=file,
        metavar="FILE",
        help="also write the lap as a log: .log, .csv, .npz, .bag or .mcap",
    )
    parser.add_argument("--out", type=folder, required=True, metavar="DIR", help="output folder")


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    del given
    from benchmarks.execution.apart import where_safe
    from benchmarks.pictures.lap import run_lap
    from localizers.naming.registry import complete

    named = (complete(options.localizer),)
    own = params_named(options.param, named)
    trials = sweep_of(options, named, own=own).distinct()
    log = None if options.log is None else options.log.absolute()
    with doing(f"running and drawing a lap of {trials[0].localizer}"):
        return where_safe(trials, run_lap, *trials, options.out.absolute(), log)
