"""Write the report of the finished trials in a folder, or in several of the same worlds.

That is report.html, results.md with its images, and the tables results.csv, trials.csv and
timings.csv. No code that a folder names is run: animations are those that the sweep drew. Several
folders may differ in their localizers and agents only, and must be complete. --latex and --pdf
write what a paper needs into DIR/export: tables.tex (booktabs) with references.bib, and the charts.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.commands import shared

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.results import Results


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("folders", type=shared.folder, nargs="+", metavar="DIR", help="folder of results")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (DIR itself, if it is one)")
    add("--latex", action="store_true", help="also write the tables in LaTeX, and BibTeX")
    add("--pdf", action="store_true", help="also write the charts as PDF")


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
    files = rewrite_report(folder, out, results)
    if options.latex or options.pdf:
        files += _exported(out / "export", results, options)
    written = [path.relative_to(out) for path in files]
    names = [str(path) for path in written if path.parts[0] != "images"]
    said = f"{progress(results)}\nWritten to {out}: {', '.join(names)} and their images."
    return f"{said}\n{conclusion(results)}"


def _exported(out: Path, results: "Results", options: argparse.Namespace) -> list[Path]:
    """Write what a paper needs."""
    from benchmarks.files import own_folder, write_files
    from benchmarks.report.page import latex_files, pdf_files
    from deqmcl_gym.validation import InputError

    if not results.records:
        raise InputError(f"{options.folders[0]} has no finished trial: run its sweep first.")
    contents = latex_files(results) if options.latex else {}
    if options.pdf:
        contents |= pdf_files(results)
    return write_files(own_folder(out, next(iter(contents))), contents)
