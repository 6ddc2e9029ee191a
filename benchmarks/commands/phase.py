"""``deqmcl phase``."""

import argparse
from collections.abc import Sequence

from benchmarks.commands.shared import (
    add_setting,
    folder,
    localizers_named,
    setting_words,
    sweep_of,
)
from benchmarks.console import doing

NAME = "phase"
HELP = "draw the queue as place fields over the theta phase"
DESCRIPTION = (
    "Run one lap of each localizer and draw what its queue holds as activity of place fields over "
    "the theta phase (past early, future late), and as the table of the queue."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_setting(parser)
    parser.add_argument(
        "--localizers", metavar="A,B,…", help="methods, comma-separated (MCL's and DEQ-MCL's)"
    )
    parser.add_argument(
        "--fields", type=int, default=12, metavar="K", help="place fields along the lap (12)"
    )
    parser.add_argument("--out", type=folder, required=True, metavar="DIR", help="output folder")


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.apart import where_safe
    from benchmarks.studies.phase.command import METHODS, run_phase

    named = options.localizers
    sweep = sweep_of(options, METHODS if named is None else localizers_named(named))
    title = f"The queue as theta phase: scenario {sweep.scenario}, {setting_words(sweep)}"
    trials, out, command = sweep.distinct(), options.out.absolute(), ["deqmcl", *given]
    with doing("running and drawing a lap of each localizer"):
        return where_safe(trials, run_phase, trials, options.fields, out, title, command)
