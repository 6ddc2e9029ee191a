"""``deqmcl basin``: how wrong may the start be? Shares of runs localized, over errors of the start.

A sweep whose prior is displaced by every distance and angle of a grid, on the same worlds for all
localizers; its shares as a table and a heat map per localizer.
"""

import math
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

from benchmarks.files import write_files
from benchmarks.pictures import styled
from benchmarks.pictures.figures import png_of
from benchmarks.replay.command import methods_of, own_params
from benchmarks.replay.options import length_and_angle
from benchmarks.report.writing import no_report
from benchmarks.setup.changes import Changes
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.names import scenario as named
from benchmarks.sweeps.design import Axis, Sweep
from benchmarks.sweeps.results import Results
from benchmarks.sweeps.running import Options, begun, complete
from benchmarks.tables.stats import wilson
from benchmarks.tables.text import csv_text, percent, short_names
from benchmarks.trials.collecting import WholeRun
from benchmarks.trials.fixes import settled
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.files import utf8
from deqmcl_gym.maps.clusters import Near
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, number

MOSTLY = 0.9  # share of runs: the boundary that is drawn
_COLUMNS = (
    *("localizer", "distance_m", "angle_deg", "runs", "localized", "share", "share_low"),
    *("share_high", "metres_median", "steps_median"),
)


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is varied, and what counts as localized.

    Attributes:
        distances: errors of the start's position, m, ascending.
        angles: errors of its heading, rad, ascending.
        spread: standard deviations of the prior, m and rad.
        near: the best cluster is at most so far off, m and rad, when localized.
        within: way or steps until then.
        unit: of ``within``: "m" or "steps".
    """

    distances: tuple[float, ...]
    angles: tuple[float, ...]
    spread: tuple[float, float]
    near: tuple[float, float]
    within: float
    unit: str

    @classmethod
    def told(cls, distances: str, angles: str, spread: str, near: str, within: str) -> "Question":
        """Return what the options say.

        Raises:
            InputError: one of them has another form, or a number is out of range.
        """
        match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(m|steps)\s*", within)
        if match is None or not float(match[1]) > 0:
            raise InputError(
                f"--within is {within!r}, but must be a way or a number of steps above 0, as 10m "
                "or 50steps."
            )
        return cls(
            distances=_listed("--distances", distances, 1000.0),
            angles=tuple(map(math.radians, _listed("--angles", angles, 180.0))),
            spread=length_and_angle("--spread", spread),
            near=length_and_angle("--localized", near),
            within=float(match[1]),
            unit=match[2],
        )

    def check_segment(self, length: float) -> None:
        """Refuse segments of a log, of a length in m, that end before ``within`` does.

        Raises:
            InputError: they are no longer than that.
        """
        if self.unit == "m" and length <= self.within:
            raise InputError(
                f"--segment is {length:g} m, but must be longer than --within, {self.within:g} m: "
                "give a longer segment or a shorter way."
            )

    @property
    def words(self) -> str:
        """What is asked, in a sentence."""
        (near, turned), (sd, sd_heading) = self.near, self.spread
        return (
            f"Localized: within {self.within:g} {self.unit} the best cluster comes within "
            f"{near:g} m and {math.degrees(turned):.0f}° of the truth, and stays there to the end "
            f"of the run. The prior is a Gaussian of {sd:g} m and {math.degrees(sd_heading):.0f}° "
            "around a mean that is wrong by the distance and the angle."
        )

    def reached(self, run: WholeRun) -> tuple[float, float] | None:
        """Return the metres and steps until a run is localized for good; None: it never is."""
        off, turned = np.array(run.curves["distance"]), np.array(run.curves["angle"])
        first = settled(Near(*self.near).holds(off, turned))
        return None if first is None else (run.curves["way"][first], float(first))

    def counts(self, reached: tuple[float, float] | None) -> bool:
        """Whether that is soon enough."""
        return reached is not None and reached[self.unit == "steps"] <= self.within


@dataclass(frozen=True, kw_only=True)
class Basin:
    """Of one localizer: what came of its runs at each error of the start.

    Attributes:
        label: its name for readers.
        runs: finished and failed ones by distance and angle, (d, a).
        localized: of them, those that count, (d, a).
        metres, steps: median until localized, inf if half of the runs or more never are, (d, a).
    """

    label: str
    runs: Floats
    localized: Floats
    metres: Floats
    steps: Floats

    @property
    def share(self) -> Floats:
        """Of the runs, those localized, (d, a); NaN where none was run."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.localized / self.runs)

    def farthest(self, axis: int) -> int | None:
        """Index of the largest error along an axis, the other one least, up to which all do.

        None: not even the first.
        """
        least = self.share[:, 0] if axis == 0 else self.share[0]
        short = np.flatnonzero(~(least >= MOSTLY))
        last = (int(short[0]) if short.size else len(least)) - 1
        return last if last >= 0 else None


def basin_sweep(
    question: Question,
    localizers: Sequence[str],
    *,
    title: str,
    scenario: str,
    world: Changes,
    assumed: Changes,
    particles: int | None,
    own: Mapping[str, Mapping[str, Any]],
    trials: int,
    seed: int,
) -> Sweep:
    """Return the sweep over all errors of the start.

    Raises:
        InputError: an unknown localizer, one named twice, or something of the world is refused.
    """
    methods = methods_of(localizers, particles, own)
    rooms = (
        {}
        if isinstance(named(scenario), LogScenario)
        else {"start.sd_position": 0.0, "start.sd_heading": 0.0}
    )
    base = Sweep(
        title=title,
        localizers=methods,
        scenario=scenario,
        lag=0,
        world=world | rooms,  # else the true start would be off, too
        assumed=assumed,
        seed=seed,
        trials=trials,
        baseline=localizers[0],
        takes=own_params,
    )
    size = metre(Stage.of(next(base.cells())).scenario.unit)
    prior = {
        "prior.kind": "displaced",
        "prior.sd_position": question.spread[0] * size,
        "prior.sd_heading": question.spread[1],
    }
    told = {name: value for name, value in assumed.items() if not name.startswith("prior.")}
    lengths = tuple(distance * size for distance in question.distances)
    return replace(
        base,
        assumed=Changes({**told, **prior}),
        vary=(
            Axis(values=Changes({"assumed.prior.distance": lengths})),
            Axis(values=Changes({"assumed.prior.angle": question.angles})),
        ),
    )


def run_basin(
    question: Question, sweep: Sweep, out: Path, options: Options, command: Sequence[str]
) -> str:
    """Run what is missing, write tables and picture; return what to print.

    Args:
        question: what is asked.
        sweep: of ``basin_sweep``, checked.
        out: folder; refused if it holds what is not of this sweep.
        options: how the runs run.
        command: the words that this was started by.

    Raises:
        TrialsFailedError: some runs failed; what the others gave is written.
    """
    with begun(sweep, out, options, command=command) as running:
        results = running.results()
        basins = basins_of(question, sweep, results)
        contents = {
            "basin.csv": utf8(_csv(question, basins)),
            "basin.md": utf8(_page(question, sweep, basins)),
        }
        if (why := no_report()) is None:
            contents["basin.png"] = heat_maps(question, sweep, basins)
        files = write_files(out, contents)
    lines = [*_summary(question, basins), "", question.words, ""]
    lines.append(f"Written to {out}: {', '.join(path.name for path in files)}.")
    if why is not None:
        lines.append(f"No picture: {why}")
    return complete(results, "\n".join(lines))


def basins_of(question: Question, sweep: Sweep, results: Results) -> list[Basin]:
    """Return the basin of each localizer of a sweep; a failed run counts as never localized."""
    lengths, angles = (next(iter(axis.values.values())) for axis in sweep.vary)
    found: dict[str, dict[tuple[int, int], list[tuple[float, float] | None]]] = {}
    ended: list[tuple[Trial, tuple[float, float] | None]] = [
        (one.trial, None if one.journey is None else question.reached(one.journey))
        for one in results.records
    ]
    for trial, reached in [*ended, *((failure.trial, None) for failure in results.failures)]:
        at = lengths.index(trial.assumed["prior.distance"])
        place = at, angles.index(trial.assumed["prior.angle"])
        found.setdefault(trial.localizer, {}).setdefault(place, []).append(reached)
    short = short_names([method.name for method in sweep.localizers])
    basins = []
    for method in sweep.localizers:
        shape = (len(lengths), len(angles))
        runs, localized = np.zeros(shape), np.zeros(shape)
        metres, steps = np.full(shape, math.nan), np.full(shape, math.nan)
        for place, own in found.get(method.name, {}).items():
            runs[place] = len(own)
            localized[place] = sum(map(question.counts, own))
            ways = [(math.inf, math.inf) if one is None else one for one in own]
            metres[place], steps[place] = map(statistics.median_high, zip(*ways, strict=True))
        label = short[method.name]
        basins.append(
            Basin(label=label, runs=runs, localized=localized, metres=metres, steps=steps)
        )
    return basins


def heat_maps(question: Question, sweep: Sweep, basins: Sequence[Basin]) -> bytes:
    """Return a heat map of the shares for each localizer, as PNG; a line bounds 90 %.

    The line runs between cells: nothing is interpolated.
    """
    with styled({"font.size": 9, "text.parse_math": False}):
        from matplotlib.figure import Figure

        columns = min(3, len(basins))
        rows = -(-len(basins) // columns)
        width, height = (max(2.2, 0.55 * len(e)) for e in (question.angles, question.distances))
        size = (columns * (width + 0.6) + 1.1, rows * (height + 0.7) + 0.5)
        figure = Figure(figsize=size, dpi=110, layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, basin in zip(grid, basins, strict=False):
            share = basin.share
            image = axes.pcolormesh(share, cmap="Blues", vmin=0, vmax=1, edgecolors="white")
            for (d, a), value in np.ndenumerate(share):
                if not math.isnan(value):
                    ink = "white" if value > 0.6 else "#1f2328"
                    axes.text(a + 0.5, d + 0.5, f"{100 * value:.0f}", color=ink, ha="center",
                              va="center")  # fmt: skip
            for x, y in _boundary(share >= MOSTLY):
                axes.plot(x, y, color="#d55e00", linewidth=2.5, solid_capstyle="projecting")
            turned = [f"{math.degrees(angle):g}°" for angle in question.angles]
            axes.set_xticks(np.arange(len(turned)) + 0.5, turned)
            away = [f"{distance:g}" for distance in question.distances]
            axes.set_yticks(np.arange(len(away)) + 0.5, away)
            axes.tick_params(length=0)
            axes.set_title(basin.label, loc="left", fontweight="bold")
            axes.set(xlabel="start wrong by (heading)", ylabel="start wrong by (m)")
        for axes in grid[len(basins) :]:
            axes.set_axis_off()
        bar = figure.colorbar(
            image, ax=grid.tolist(), shrink=0.8, ticks=[0, 0.25, 0.5, 0.75, 0.9, 1]
        )
        bar.ax.set_yticklabels(["0", "25", "50", "75", "90", "100"])
        bar.ax.axhline(MOSTLY, color="#d55e00", linewidth=2.5)
        bar.set_label(f"% of {sweep.trials} runs localized within {question.within:g} "
                      f"{question.unit}")  # fmt: skip
        return png_of(figure)


def _boundary(inside: NDArray[np.bool_]) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Yield the edges, x and y of both ends, between cells (rows, columns) inside and outside."""
    for row, column in zip(*np.nonzero(inside[1:] != inside[:-1]), strict=True):
        yield (int(column), int(column) + 1), (int(row) + 1, int(row) + 1)
    for row, column in zip(*np.nonzero(inside[:, 1:] != inside[:, :-1]), strict=True):
        yield (int(column) + 1, int(column) + 1), (int(row), int(row) + 1)


def _csv(question: Question, basins: Iterable[Basin]) -> str:
    lines = (
        [
            *(basin.label, distance, round(math.degrees(angle), 9)),
            *(int(basin.runs[d, a]), int(basin.localized[d, a]), float(basin.share[d, a])),
            *wilson(float(basin.share[d, a]), int(basin.runs[d, a])),
            *(float(basin.metres[d, a]), float(basin.steps[d, a])),
        ]
        for basin in basins
        for d, distance in enumerate(question.distances)
        for a, angle in enumerate(question.angles)
    )
    return csv_text(_COLUMNS, lines)


def _page(question: Question, sweep: Sweep, basins: Sequence[Basin]) -> str:
    """Return the shares as Markdown, a table per localizer."""
    parts = [f"# {sweep.title}", question.words, "\n".join(_summary(question, basins))]
    header = ["start wrong by", *(f"{math.degrees(angle):g}°" for angle in question.angles)]
    for basin in basins:
        rows = [
            [f"{distance:g} m", *(percent(value) for value in shares)]
            for distance, shares in zip(question.distances, basin.share.tolist(), strict=True)
        ]
        bold = [
            [row[0], *(f"**{c}**" if v >= MOSTLY else c for c, v in zip(row[1:], own, strict=True))]
            for row, own in zip(rows, basin.share.tolist(), strict=True)
        ]
        table = tabulate(bold, header, tablefmt="pipe", disable_numparse=True)
        parts += [f"## {basin.label}", table]
    parts.append(f"Bold: {percent(MOSTLY)} or more, of {sweep.trials} runs each.")
    return "\n\n".join(parts) + "\n"


def _summary(question: Question, basins: Iterable[Basin]) -> list[str]:
    """Say of each localizer how wrong its start may be in one respect, the other one least."""
    least, straight = f"{question.distances[0]:g} m", f"{math.degrees(question.angles[0]):g}°"
    lines = []
    for basin in basins:
        far, turned = basin.farthest(0), basin.farthest(1)
        if far is None or turned is None:
            words = f"in fewer than {percent(MOSTLY)} of the runs even at {least} and {straight}"
        else:
            words = (
                f"in {percent(MOSTLY)} of the runs or more up to {question.distances[far]:g} m at "
                f"{straight}, and up to {math.degrees(question.angles[turned]):g}° at {least}"
            )
        lines.append(f"- {basin.label}: localized {words}.")
    return lines


def _listed(option: str, text: str, most: float) -> tuple[float, ...]:
    """Return numbers of "0,0.5,1", ascending and different."""
    try:
        found = [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError(f"{option} is {text!r}, but must be numbers, as in 0,1,2.") from None
    for value in found:
        number(option, value, low=0, high=most)
    if sorted(set(found)) != found:
        raise InputError(f"{option} is {text!r}, but must be ascending: name each once.")
    return tuple(found)
