"""``deqmcl speed``."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from benchmarks.commands.shared import folder

NAME = "speed"
HELP = "measure speed against NumPy, pymunk, CartPole and peers"
DESCRIPTION = (
    "Measure rays, filter steps and environment steps by CPU time of one core, as ratios to others "
    "measured in the same run."
)
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--quick", action="store_true", help="less exact, in under a minute")
    parser.add_argument(
        "--peers", action="store_true", help="also compare with other packages, if installed"
    )
    parser.add_argument(
        "--out",
        type=folder,
        default=Path("results/speed"),
        metavar="DIR",
        help="output folder (results/speed)",
    )


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    for name in _THREADS:  # read by the libraries when they are loaded, below
        os.environ[name] = "1"
    from benchmarks.studies.speed.command import FULL, QUICK, run_speed

    extent = QUICK if options.quick else FULL
    command = ["deqmcl", *given]
    return run_speed(options.out, extent=extent, peers=options.peers, command=command)
