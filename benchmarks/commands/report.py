"""Write the report of the finished trials in a folder.

That is report.html, results.md with its images, and the tables results.csv, trials.csv and
timings.csv. No code that the folder names is run: animations are those that the sweep drew.
"""

import argparse
import sys

from benchmarks.commands import shared


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("folder", type=shared.folder, metavar="DIR", help="folder of results")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (DIR itself)")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.report.words import conclusion, progress
    from benchmarks.report.writing import require_report, rewrite_report
    from benchmarks.sweeps.results import left_out_lines, results_in

    require_report()
    results = results_in(options.folder)
    for line in left_out_lines(results, options.folder):
        print(line, file=sys.stderr)
    out = options.out or options.folder
    written = [path.relative_to(out) for path in rewrite_report(options.folder, out, results)]
    names = [str(path) for path in written if len(path.parts) == 1]
    said = f"{progress(results)}\nWritten to {out}: {', '.join(names)} and their images."
    return f"{said}\n{conclusion(results).text}"
