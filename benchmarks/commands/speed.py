"""Measure rays, filter steps and environment steps by CPU time of one core.

The figures are ratios to others measured in the same run.
"""

import argparse
import os

from benchmarks.commands import shared


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("--quick", action="store_true", help="less exact, in under a minute")
    add("--peers", action="store_true", help="also compare with other packages, if installed")
    shared.add_out(parser, "results/speed")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.starting import ONE_THREAD

    os.environ.update(ONE_THREAD)  # read by the libraries when they are loaded, below
    from benchmarks.studies.speed.command import FULL, QUICK, run_speed

    extent = QUICK if options.quick else FULL
    return run_speed(options.out, extent=extent, peers=options.peers, command=options.words)
