"""Write the report of the finished trials in a folder, or in several of the same worlds.

That is report.html, results.md with its images, and the tables results.csv, trials.csv and
timings.csv. No code that a folder names is run: animations are those that the sweep drew. Several
folders may differ in their localizers and agents only, and must be complete.
"""

import argparse
import sys
from pathlib import Path

from benchmarks.commands import shared


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("folders", type=shared.folder, nargs="+", metavar="DIR", help="folder of results")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (DIR itself, if it is one)")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.report.verdict import conclusion, progress
    from benchmarks.report.writing import require_report, rewrite_report
    from benchmarks.sweeps.results import left_out_lines, pooled, results_in
    from deqmcl_gym.validation import InputError

    require_report()
    (folder, *more), out = options.folders, options.out or options.folders[0]
    if more and out.resolve() == folder.resolve():
        raise InputError("several folders make one report: give --out DIR, a new folder for it.")
    results = pooled(options.folders, options.words) if more else results_in(folder)
    for line in left_out_lines(results, Path() if more else folder):
        print(line, file=sys.stderr)
    written = [path.relative_to(out) for path in rewrite_report(folder, out, results)]
    names = [str(path) for path in written if len(path.parts) == 1]
    said = f"{progress(results)}\nWritten to {out}: {', '.join(names)} and their images."
    return f"{said}\n{conclusion(results)}"
