"""``deqmcl speed``: measure the figures and the curves, write them down."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from benchmarks.files import writable_folder, write_bytes, write_text
from benchmarks.speed import rays, steps, trials, worlds
from benchmarks.speed.figure import Figure, Measured, UnavailableError, measured
from benchmarks.speed.plots import ratios_plot, scaling_plot
from benchmarks.speed.scaling import Measurement, curves, scaled
from benchmarks.speed.tables import (
    HOW,
    scaling_csv,
    scaling_tables,
    speed_csv,
    speed_table,
    terminal_table,
)
from benchmarks.speed.timing import Effort
from benchmarks.trials.provenance import environment

T = TypeVar("T")

FIGURES = (*rays.FIGURES, *steps.FIGURES, *trials.FIGURES, *worlds.FIGURES)

RATIOS, CURVES = "speed.png", "scaling.png"
_SHOWS = {RATIOS: "The ratios as bars, with their targets", CURVES: "The tables as curves"}


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How much is measured, and for how long.

    Attributes:
        figures, scaling: effort for either.
        largest: number of particles of the scaling curves.
    """

    figures: Effort
    scaling: Effort
    largest: int


FULL = Extent(
    figures=Effort(repeats=15, seconds=0.2),
    scaling=Effort(repeats=5, seconds=0.1),
    largest=1_000_000,
)
QUICK = Extent(
    figures=Effort(repeats=11, seconds=0.06),
    scaling=Effort(repeats=3, seconds=0.01),
    largest=100_000,
)


def run_speed(out: Path, *, extent: Extent, peers: bool, command: Sequence[str]) -> str:
    """Measure, write the files; return what to print."""
    writable_folder(out)
    rows, reasons = _measure(FIGURES, extent.figures, peers=peers)
    chosen = curves(largest=extent.largest)
    seen = list(_progress(scaled(chosen, extent.scaling), len(chosen), "scaling"))
    write_text(out / "speed.csv", speed_csv(rows))
    write_text(out / "scaling.csv", scaling_csv(seen))
    pictures = _pictures(rows, seen)
    for name, picture in pictures.items():
        write_bytes(out / name, picture)
    if not pictures:
        reasons += ["No pictures: pip install 'deqmcl-gym[plots]' brings what they need."]
    write_text(out / "speed.md", _markdown(rows, reasons, seen, pictures, command))
    written = ["speed.csv", "scaling.csv", *pictures, "speed.md"]
    return "\n\n".join(
        part
        for part in (
            terminal_table(rows),
            HOW,
            "\n".join(reasons),
            f"Written to {out}: {', '.join(written)}.",
        )
        if part
    )


def _measure(
    figures: Sequence[Figure], effort: Effort, *, peers: bool
) -> tuple[list[Measured], list[str]]:
    """Return the rows, and a line for each reason why others have none."""
    rows: list[Measured] = []
    without: dict[str, list[str]] = {}
    for figure in _progress(figures, len(figures), "figures"):
        try:
            if figure.peer is not None and not peers:
                raise UnavailableError("peers are measured with --peers only")
            rows.append(measured(figure, effort))
        except UnavailableError as error:
            without.setdefault(str(error), []).append(figure.name)
    return rows, [f"No row: {', '.join(names)}: {why}." for why, names in without.items()]


def _markdown(
    rows: Sequence[Measured],
    reasons: Sequence[str],
    scaling: Sequence[Measurement],
    pictures: Iterable[str],
    command: Sequence[str],
) -> str:
    machine = environment()
    libraries = machine["libraries"]
    assert isinstance(libraries, dict)
    versions = [f"Python {machine['python']}", *(f"{k} {v}" for k, v in libraries.items())]
    shown = {name: f"![{_SHOWS[name]}]({name})" for name in pictures}
    parts = [
        "# Speed",
        f"`{shlex.join(command)}`",
        speed_table(rows, "github"),
        HOW,
        *reasons,
        f"{', '.join(versions)}; {machine['platform']}.",
        shown.get(RATIOS, ""),
        "## Scaling",
        scaling_tables(scaling),
        shown.get(CURVES, ""),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _pictures(rows: Sequence[Measured], scaling: Sequence[Measurement]) -> dict[str, bytes]:
    """Return the pictures by name; none without matplotlib."""
    if find_spec("matplotlib") is None:
        return {}
    return {RATIOS: ratios_plot(rows), CURVES: scaling_plot(scaling)}


def _progress(items: Iterable[T], total: int, what: str) -> Iterable[T]:
    return tqdm(items, desc=what, total=total, disable=None, leave=False)
