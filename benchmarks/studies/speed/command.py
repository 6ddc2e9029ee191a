"""``deqmcl speed``: measure the figures and the curves, write them down."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from tabulate import tabulate
from tqdm import tqdm

from benchmarks.files import own_folder, write_files
from benchmarks.studies.speed import rays, steps, worlds
from benchmarks.studies.speed.figure import Effort, Measured, digits, figures_table, measured
from benchmarks.tables.text import csv_text
from benchmarks.trials.provenance import environment
from deqmcl_gym.files import command_line

T = TypeVar("T")

FIGURES = (*rays.FIGURES, *steps.FIGURES, *worlds.FIGURES)
PEERS = (*rays.PEERS, *steps.PEERS)
_HOW = (
    "CPU time of one core (of trials: wall time), medians of turns taken one after the other in "
    "one process. The ratio is ours over the other's, of rates (more is faster) or of times (less "
    "is faster). A row without a ratio compares with a figure from another machine."
)


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How long figures and curves are measured, and the largest number of particles."""

    figures: Effort
    scaling: Effort
    largest: int


FULL = Extent(figures=Effort(15, seconds=0.2), scaling=Effort(5, seconds=0.1), largest=1_000_000)
QUICK = Extent(figures=Effort(11, seconds=0.06), scaling=Effort(3, seconds=0.01), largest=100_000)


def run_speed(out: Path, *, extent: Extent, peers: bool, command: Sequence[str]) -> str:
    """Measure, write the files; return what to print."""
    own_folder(out, "speed.csv")
    rows, reasons = _measured(extent.figures, peers=peers)
    chosen = steps.curves(largest=extent.largest)
    seen = list(_progress(steps.scaled(chosen, extent.scaling), len(chosen), "scaling"))
    # rates are per second, times in their unit
    lines = ([row.figure.name, *map(digits, (row.ours, row.other, row.ratio))] for row in rows)
    table = csv_text(["figure", "ours", "other", "ratio"], lines)
    files = {"speed.csv": table.encode(), "scaling.csv": steps.scaling_csv(seen).encode()}
    if find_spec("matplotlib"):
        files["scaling.png"] = steps.scaling_plot(seen)
    else:
        reasons += ["No picture: run pip install 'deqmcl-gym[plots]'."]
    files["speed.md"] = _page(rows, reasons, seen, "scaling.png" in files, command).encode()
    write_files(out, files)
    written = f"Written to {out}: {', '.join(files)}."
    return "\n\n".join([figures_table(rows, "simple"), _HOW, *reasons, written])


def _measured(effort: Effort, *, peers: bool) -> tuple[list[Measured], list[str]]:
    """Return the rows, and a line for each reason why some figures have none."""
    rows = [measured(figure, effort) for figure in _progress(FIGURES, len(FIGURES), "figures")]
    if not peers:
        names = ", ".join(figure.name for figure in PEERS)
        return rows, [f"No row: {names}: peers are measured only with --peers."]
    reasons = []
    for figure in _progress(PEERS, len(PEERS), "peers"):
        try:
            rows.append(measured(figure, effort))
        except ImportError as error:
            reasons.append(f"No row: {figure.name}: {error} (docs/speed.md says what to install).")
    return rows, reasons


def _page(
    rows: Sequence[Measured],
    reasons: Sequence[str],
    scaling: Sequence[steps.Scaling],
    picture: bool,
    command: Sequence[str],
) -> str:
    """Return speed.md."""
    machine = environment()
    libraries = machine["libraries"]
    assert isinstance(libraries, dict)
    versions = [f"Python {machine['python']}", *(f"{k} {v}" for k, v in libraries.items())]
    sides = [[f.name, f.what, f.ours.who, f.other.who] for f in (row.figure for row in rows)]
    parts = [
        "# Speed",
        f"`{command_line(command)}`",
        figures_table(rows, "github"),
        _HOW,
        *reasons,
        f"{', '.join(versions)}; {machine['platform']}.",
        "## What is compared",
        tabulate(sides, ["figure", "what", "ours", "other"], tablefmt="github"),
        "## Scaling",
        steps.scaling_tables(scaling),
        *["![The tables as curves](scaling.png)"] * picture,
    ]
    return "\n\n".join(parts) + "\n"


def _progress(items: Iterable[T], total: int, what: str) -> Iterable[T]:
    return tqdm(items, desc=what, total=total, disable=None, leave=False)
