"""Write leaderboard.html and leaderboard.md from folders of results. Nothing is run.

The folders differ in their localizers only. Those of another scenario, other worlds or another
baseline are refused.
"""

import argparse

from benchmarks.commands import shared
from benchmarks.console import doing


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "folders", type=shared.folder, nargs="+", metavar="DIR", help="folders of complete results"
    )
    shared.add_out(parser, "results/leaderboard")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.files import own_folder, write_part
    from benchmarks.report.writing import require_report

    require_report()
    from benchmarks.report.leaderboard import leaderboard_files, sources

    with doing("reading the folders"):
        contents = leaderboard_files(sources(options.folders), options.words)
    files = write_part(own_folder(options.out, "leaderboard"), "leaderboard", contents)
    return f"Written to {options.out}: {', '.join(path.name for path in files)}."
