"""``deqmcl leaderboard``."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.commands.shared import folder
from benchmarks.console import doing

NAME = "leaderboard"
HELP = "rank the methods of several folders of results on the same worlds"
DESCRIPTION = (
    "Write leaderboard.html and leaderboard.md from folders of results that differ in their "
    "localizers only. Folders of another scenario, other worlds or another baseline are refused. "
    "Nothing is run."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "folders", type=folder, nargs="+", metavar="DIR", help="folders of complete results"
    )
    parser.add_argument(
        "--out",
        type=folder,
        default=Path("results/leaderboard"),
        metavar="DIR",
        help="output folder (results/leaderboard)",
    )


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    from benchmarks.files import own_folder, write_part
    from benchmarks.report import require_report

    require_report()
    from benchmarks.report.leaderboard import leaderboard_files, sources

    with doing("reading the folders"):
        contents = leaderboard_files(sources(options.folders), ["deqmcl", *given])
    files = write_part(own_folder(options.out, "leaderboard"), "leaderboard", contents)
    return f"Written to {options.out}: {', '.join(path.name for path in files)}."
