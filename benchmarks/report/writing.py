"""Write report.html, the tables, results.md and the pictures that the Markdown needs."""

import json
import logging
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from benchmarks.console import doing
from benchmarks.files import writable_folder, write_bytes, written
from benchmarks.sweeps.results import Results
from benchmarks.tables.csv_files import gaps_csv, results_csv, timings_csv, trials_csv
from benchmarks.tables.panels import panels
from benchmarks.trials.provenance import source_of
from deqmcl_gym.validation import InputError

IMAGES = "images"


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
    """Refuse to go on without what a report is made with.

    Raises:
        InputError: naming the pip command.
    """
    if (why := no_report()) is not None:
        raise InputError(why)


def write_report(out: Path, results: Results) -> list[Path]:
    """Write the tables, report.html, results.md and images/ into a folder; return the files.

    results.csv and trials.csv depend on nothing but the trials; timings.csv, the page and
    results.md also tell times and versions. Without the extra ``report`` there are the tables only.
    Nothing is written if all is there and would come out the same.

    Raises:
        InputError: ``out`` cannot be written to.
    """
    writable_folder(out)
    with doing(f"writing the report in {out}"):
        return written(out / "written.json", _source(results), lambda: _write(out, results))


def _source(results: Results) -> str:
    """Name all that a report is made of: results, code and libraries."""
    digest = sha256(f"{source_of('benchmarks')} {no_report()}".encode())
    for library in ("jinja2", "matplotlib", "opencv-python-headless", "pillow"):
        with suppress(PackageNotFoundError):
            digest.update(f"{library} {version(library)}".encode())
    for part in vars(results).items():
        for chunk in json.JSONEncoder(default=vars).iterencode(part):
            digest.update(chunk.encode())
    return digest.hexdigest()


def _write(out: Path, results: Results) -> list[Path]:
    compared = panels(results.records, results.baseline, results.limits)
    contents = {
        "results.csv": results_csv(compared).encode(),
        "trials.csv": trials_csv(results.finished).encode(),
        "timings.csv": timings_csv(results.finished).encode(),
    }
    if any(panel.gaps for panel in compared):
        contents["gaps.csv"] = gaps_csv(compared).encode()
    for name, content in contents.items():
        write_bytes(out / name, content)
    if no_report() is not None:
        return [out / name for name in contents]
    # it warns of a home that it cannot write to
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from benchmarks.report.html import html
    from benchmarks.report.markdown import images, markdown
    from benchmarks.report.story import story_of

    story = story_of(compared, results)
    told = {"results.md": markdown(story, IMAGES).encode(), "report.html": html(story).encode()}
    told |= {f"{IMAGES}/{name}": content for name, content in images(story).items()}
    for name, content in told.items():
        write_bytes(out / name, content)
    return [out / name for name in [*contents, *told]]
