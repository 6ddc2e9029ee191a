"""Write report.html, the tables, and the pictures of the page."""

import logging
from importlib.util import find_spec
from pathlib import Path

from benchmarks.console import doing
from benchmarks.files import own_folder, write_files
from benchmarks.report.swept import starts_table
from benchmarks.sweeps.manifest import MANIFEST
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import FURTHER
from benchmarks.tables.frames import INNER, csv_of, timings_table, trials_frame
from deqmcl_gym.files import utf8
from deqmcl_gym.validation import InputError, shown


def no_report() -> str | None:
    """Say why a report cannot be made here, naming the pip command; None if it can."""
    missing = [name for name in ("jinja2", "matplotlib") if find_spec(name) is None]
    if not missing:
        return None
    return (
        f"a report needs {' and '.join(missing)}, which is not installed: "
        "pip install 'deqmcl-gym[report]'."
    )


def require_report() -> None:
    """Refuse to go on without what a report is made with."""
    if (why := no_report()) is not None:
        raise InputError(why)


def load() -> None:
    """Load what a page is drawn with, if it is installed: half a second."""
    if no_report() is None:
        # it warns of a home that it cannot write to
        logging.getLogger("matplotlib").setLevel(logging.ERROR)
        import matplotlib.figure  # noqa: F401

        from benchmarks.report import page  # noqa: F401


def write_report(
    out: Path | str, results: Results, *, draw: bool = True, of: Path | None = None
) -> list[Path]:
    """Write the tables, report.html and images/ of a sweep; return the files.

    Films that the folder has not are drawn, unless ``draw`` is false; those and the figures ``of``
    another folder are shown if it is given. results.csv and trials.csv depend on nothing but the
    trials; timings.csv and the page also tell times and versions. Without the extra
    ``report`` there are the tables only. A folder that holds files, but neither a sweep nor a
    report, raises ``InputError``.
    """
    if not isinstance(results, Results):
        raise InputError(f"the results are {shown(results)}: give the folder first, then results.")
    folder = Path(out)
    with doing(f"writing the report in {folder}"):
        if of is not None or not (folder / MANIFEST).is_file():
            own_folder(folder, "results.csv")
        tables = _tables(results)
        for name in ("decisions.csv", "plans.csv", "maps.csv", "basin.csv"):
            if name not in tables:
                (folder / name).unlink(missing_ok=True)
        files = write_files(folder, tables)  # the numbers, whatever keeps the pictures away
        if no_report() is not None:
            return files
        load()
        from benchmarks.report.page import page_files

        pages = page_files(results, of or folder, draw=draw)
        for path in (folder / "images").glob("lap-*"):  # of worlds that are not shown any more
            if f"images/{path.name}" not in pages:
                path.unlink()
        return files + write_files(folder, pages)


def _tables(results: Results) -> dict[str, bytes]:
    tables = {
        "results.csv": csv_of(results.table, FURTHER),
        "trials.csv": csv_of(trials_frame(results.records), INNER),
        "timings.csv": csv_of(timings_table(results.records)),
    }
    starts = starts_table(results.records, (failure.trial for failure in results.failures))
    further = {"plans": results.plans, "maps": results.maps, "basin": starts}
    if results.rule is not None:
        tables["decisions.csv"] = csv_of(results.decisions)
    tables |= {f"{name}.csv": csv_of(own) for name, own in further.items() if len(own)}
    return {name: utf8(text) for name, text in tables.items()}
