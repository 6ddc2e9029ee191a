"""Run one lap of each localizer and draw what its queue holds.

It is drawn as activity of place fields over the theta phase (past early, future late), and as the
table of the queue.
"""

import argparse

from benchmarks.commands import shared
from benchmarks.console import doing


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    shared.add_setting(parser)
    add("--localizers", metavar="A,B,…", help="methods, comma-separated (MCL's and DEQ-MCL's)")
    add("--fields", type=int, default=12, metavar="K", help="place fields along the lap (12)")
    shared.add_out(parser)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.studies.phase.command import METHODS, run_phase

    named = options.localizers
    sweep = shared.setting_sweep(
        options, METHODS if named is None else shared.localizers_named(named)
    )
    title = f"The queue as theta phase: scenario {sweep.scenario}, {shared.setting_words(sweep)}"
    trials, out, command = sweep.distinct(), options.out.absolute(), options.words
    with doing("running and drawing a lap of each localizer"):
        return run_phase(trials, options.fields, out, title, command)
