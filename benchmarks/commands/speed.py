"""Measure rays, filter steps and environment steps by CPU time of one core.

The figures are ratios to others measured in the same run.
"""

import argparse
import os

from benchmarks.commands import shared

NAME = "speed"
HELP = "measure speed against NumPy, pymunk, CartPole and peers"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--quick", action="store_true", help="less exact, in under a minute")
    parser.add_argument(
        "--peers", action="store_true", help="also compare with other packages, if installed"
    )
    shared.add_out(parser, "results/speed")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    for name in _THREADS:  # read by the libraries when they are loaded, below
        os.environ[name] = "1"
    from benchmarks.studies.speed.command import FULL, QUICK, run_speed

    extent = QUICK if options.quick else FULL
    return run_speed(options.out, extent=extent, peers=options.peers, command=options.words)
