"""``deqmcl basin``: how wrong may the start be? Shares of runs localized, over errors of the start.

A sweep whose prior is displaced by every distance and angle of a grid, on the same worlds for all
localizers; its shares as a table and a heat map per localizer.
"""

import math
import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tabulate import tabulate

from benchmarks.files import write_files
from benchmarks.pictures import styled
from benchmarks.replay.command import methods_of, own_params
from benchmarks.replay.options import length_and_angle
from benchmarks.report.charts import STYLE, Chart, cells
from benchmarks.report.writing import no_report
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.names import scenario as named
from benchmarks.setup.overrides import Overrides
from benchmarks.sweeps.design import Axis, Sweep
from benchmarks.sweeps.results import Results
from benchmarks.sweeps.running import Options, begun, complete
from benchmarks.sweeps.settings import value_of
from benchmarks.tables.stats import wilson
from benchmarks.tables.text import csv_text, percent, short_names
from benchmarks.trials.collecting import WholeRun
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.tracks import settled
from deqmcl_gym.files import utf8
from deqmcl_gym.maps.clusters import Near
from deqmcl_gym.maps.map import metre
from deqmcl_gym.validation import InputError, number

MOSTLY = 0.9  # share of runs from which on a cell is bold
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
        """Return what the options say."""
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

    def reached(self, run: WholeRun | None) -> tuple[float, float]:
        """Return the metres and steps until a run is localized for good, inf if it never is."""
        if run is None:
            return math.inf, math.inf
        off, turned = np.array(run.curves["distance"]), np.array(run.curves["angle"])
        first = settled(Near(*self.near).holds(off, turned))
        return (math.inf, math.inf) if first is None else (run.curves["way"][first], float(first))

    def counts(self, reached: tuple[float, float]) -> bool:
        """Whether that is soon enough."""
        return reached[self.unit == "steps"] <= self.within


def basin_sweep(
    question: Question,
    localizers: Sequence[str],
    *,
    title: str,
    scenario: str,
    world: Overrides,
    assumed: Overrides,
    particles: int | None,
    own: Mapping[str, Mapping[str, Any]],
    trials: int,
    seed: int,
) -> Sweep:
    """Return the sweep over all errors of the start."""
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
        assumed=Overrides({**told, **prior}),
        vary=(
            Axis(values=Overrides({"assumed.prior.distance": lengths})),
            Axis(values=Overrides({"assumed.prior.angle": question.angles})),
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
        found = cells_of(question, sweep, results)
        contents = {
            "basin.csv": utf8(csv_text(_COLUMNS, (cell.values() for cell in found))),
            "basin.md": utf8(_page(question, sweep, found)),
        }
        if (why := no_report()) is None:
            contents["basin.png"] = _picture(found)
        files = write_files(out, contents)
    lines = [*_summary(found), "", question.words, ""]
    lines.append(f"Written to {out}: {', '.join(path.name for path in files)}.")
    if why is not None:
        lines.append(f"No picture: {why}")
    return complete(results, "\n".join(lines))


def cells_of(question: Question, sweep: Sweep, results: Results) -> list[dict[str, Any]]:
    """Return what came of the runs of each localizer at each error, with the columns of the CSV.

    A failed run counts as never localized.
    """
    ended = [(one.trial, question.reached(one.journey)) for one in results.records]
    ended += [(failure.trial, question.reached(None)) for failure in results.failures]
    by_error: dict[tuple[Any, ...], list[tuple[float, float]]] = {}
    for trial, reached in ended:
        by_error.setdefault(_error_of(trial), []).append(reached)
    lengths, angles = (next(iter(axis.values.values())) for axis in sweep.vary)
    errors = list(product(zip(lengths, question.distances, strict=True), angles))
    short = short_names([method.name for method in sweep.localizers])
    found = []
    for method, ((length, distance), angle) in product(sweep.localizers, errors):
        runs = by_error.get((method.name, length, angle), [])
        localized = sum(map(question.counts, runs))
        share = localized / len(runs) if runs else math.nan
        medians = map(statistics.median_high, zip(*runs, strict=True)) if runs else [math.nan] * 2
        cell = (short[method.name], distance, round(math.degrees(angle), 9), len(runs), localized)
        own = (*cell, share, *wilson(share, len(runs)), *medians)
        found.append(dict(zip(_COLUMNS, own, strict=True)))
    return found


def _error_of(trial: Trial) -> tuple[str, float, float]:
    return trial.localizer, trial.assumed["prior.distance"], trial.assumed["prior.angle"]


def _picture(found: Sequence[Mapping[str, Any]]) -> bytes:
    """Return a heat map of the shares for each localizer, as PNG; those of 90 % or more bold."""
    frame = pd.DataFrame(found)
    x, y = "heading wrong by, °", "start wrong by, m"
    frame = frame.rename(columns={"angle_deg": x, "distance_m": y})
    frame["text"] = [percent(share) for share in frame["share"]]
    frame["bold"] = frame["share"] >= MOSTLY
    with styled(STYLE):
        figure = cells(frame, x, y, "localizer", "share", "text", least=1.0, bold="bold")
        return Chart("basin", "", "", figure).drawn("png", dpi=110)


def _page(question: Question, sweep: Sweep, found: Sequence[Mapping[str, Any]]) -> str:
    """Return the shares as Markdown, a table per localizer."""
    parts = [f"# {sweep.title}", question.words, "\n".join(_summary(found))]
    for label, own in _by_localizer(found).items():
        rows: dict[str, list[str]] = {}
        for cell in own:
            share = percent(cell["share"])
            bold = f"**{share}**" if cell["share"] >= MOSTLY else share
            rows.setdefault(f"{cell['distance_m']:g} m", []).append(bold)
        header = ["start wrong by", *(f"{math.degrees(angle):g}°" for angle in question.angles)]
        lines = [[name, *row] for name, row in rows.items()]
        table = tabulate(lines, header, tablefmt="pipe", disable_numparse=True)
        parts += [f"## {label}", table]
    parts.append(f"Bold: {percent(MOSTLY)} or more, of {sweep.trials} runs each.")
    return "\n\n".join(parts) + "\n"


def _summary(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """Say of each localizer how wrong its start may be in one respect, the other one least."""
    lines = []
    for label, own in _by_localizer(found).items():
        least, straight = f"{own[0]['distance_m']:g} m", f"{own[0]['angle_deg']:g}°"
        far = _farthest(own, "distance_m", "angle_deg")
        turned = _farthest(own, "angle_deg", "distance_m")
        words = f"in fewer than {percent(MOSTLY)} of the runs even at {least} and {straight}"
        if far is not None:
            words = (
                f"in {percent(MOSTLY)} of the runs or more up to {far:g} m at {straight}, and up "
                f"to {turned:g}° at {least}"
            )
        lines.append(f"- {label}: localized {words}.")
    return lines


def _farthest(own: Sequence[Mapping[str, Any]], error: str, other: str) -> float | None:
    """Return the largest error up to which nearly all runs are localized, the other one least.

    None: not even at the least.
    """
    along = [cell for cell in own if cell[other] == own[0][other]]
    good = list(takewhile(lambda cell: cell["share"] >= MOSTLY, along))
    return good[-1][error] if good else None


def _by_localizer(found: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    by_label: dict[str, list[Mapping[str, Any]]] = {}
    for cell in found:
        by_label.setdefault(cell["localizer"], []).append(cell)
    return by_label


def _listed(option: str, text: str, most: float) -> tuple[float, ...]:
    """Return numbers of "0,0.5,1", ascending and different."""
    given = value_of(option, text)
    found = list(given) if isinstance(given, list) else [given]
    if not all(type(one) in (int, float) for one in found):
        raise InputError(f"{option} is {text!r}, but must be numbers, as in 0,1,2.")
    for value in found:
        number(option, value, low=0, high=most)
    if sorted(set(found)) != found:
        raise InputError(f"{option} is {text!r}, but must be ascending: name each once.")
    return tuple(map(float, found))
