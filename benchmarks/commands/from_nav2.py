"""Print the AMCL parameters of a Nav2 parameter file as a sweep file over a recorded log.

What has no counterpart becomes a comment: docs/your-map-your-log.md. deqmcl replay takes the same
file as --nav2.
"""

import argparse
from pathlib import Path


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("params", type=Path, metavar="PARAMS.yaml", help="Nav2's parameter file")
    add("--node", metavar="NAME", help="the node, as in /robot1/amcl (the only amcl)")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.replay.nav2 import read_nav2

    return read_nav2(options.params, options.node).toml.rstrip()
