"""Write what a paper needs from the finished trials in a folder. Nothing is run.

That is tables.tex (booktabs), references.bib, and the report's charts as PDF.
"""

import argparse

from benchmarks.commands import shared
from benchmarks.console import doing


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("folder", type=shared.folder, metavar="DIR", help="folder of results")
    add("--latex", action="store_true", help="only tables and BibTeX")
    add("--pdf", action="store_true", help="only figures")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (DIR/export)")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.files import own_folder, write_files
    from benchmarks.report.writing import load, require_report
    from benchmarks.sweeps.results import results_in
    from deqmcl_gym.validation import InputError

    require_report()
    results = results_in(options.folder)
    if not results.records:
        raise InputError(f"{options.folder} has no finished trial: run its sweep first.")
    everything = not (options.latex or options.pdf)
    out = options.out or options.folder / "export"
    load()
    from benchmarks.report.page import latex_files, pdf_files

    with doing(f"drawing the figures for {out}"):
        contents = latex_files(results) if options.latex or everything else {}
        if options.pdf or everything:
            contents |= pdf_files(results)
    files = write_files(own_folder(out, next(iter(contents))), contents)
    names = [str(path.relative_to(out)) for path in files]
    return f"Written to {out}: {', '.join(names)}."
