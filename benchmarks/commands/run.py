"""Run one lap of one localizer.

Writes its animation, its error curve, and its trace as npz and as TUM trajectory files (for evo).
"""

import argparse

from benchmarks.commands import shared
from benchmarks.console import checking, doing


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    shared.add_setting(parser)
    add("--localizer", required=True, metavar="NAME", help="the method")
    shared.add_set(parser)
    add(
        "--log",
        type=shared.file,
        metavar="FILE",
        help="also write the lap as a log: .csv, .csv.gz or .npz",
    )
    shared.add_mcap(parser)
    shared.add_out(parser)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.pictures.figures import run_lap
    from benchmarks.sweeps.running import check
    from localizers.registry import LOCALIZER

    mcap = shared.mcap_of(options)
    sweep = shared.setting_sweep(options, [LOCALIZER.complete(options.localizer)])
    with checking():
        check(sweep)
    (trial,) = sweep.distinct()
    log = None if options.log is None else options.log.absolute()
    with doing(f"running and drawing a lap of {trial.localizer}"):
        return run_lap(trial, options.out.absolute(), log, mcap)
