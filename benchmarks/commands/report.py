"""``deqmcl report``."""

import argparse
import sys
from collections.abc import Sequence

from benchmarks.commands.shared import folder

NAME = "report"
HELP = "rewrite the report of a folder of results"
DESCRIPTION = (
    "Write report.html, results.md with its images, and the tables results.csv, trials.csv and "
    "timings.csv, from the finished trials in a folder. No code that the folder names is run: "
    "animations are those that the sweep drew."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folder", type=folder, metavar="DIR", help="folder of results")
    parser.add_argument("--out", type=folder, metavar="DIR", help="output folder (DIR itself)")


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    del given
    from benchmarks.report import require_report, rewrite_report
    from benchmarks.report.words import conclusion, progress
    from benchmarks.sweeps.results import left_out_lines, results_in

    require_report()
    results = results_in(options.folder)
    for line in left_out_lines(results, options.folder):
        print(line, file=sys.stderr)
    out = options.out or options.folder
    written = [path.relative_to(out) for path in rewrite_report(options.folder, out, results)]
    names = [str(path) for path in written if len(path.parts) == 1]
    said = f"{progress(results)}\nWritten to {out}: {', '.join(names)} and their images."
    return f"{said}\n{conclusion(results)}"
