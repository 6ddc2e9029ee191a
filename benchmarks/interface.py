"""What a notebook types: compare localizers, look at the numbers, watch a run.

``import benchmarks``; a localizer may be a class or a function that is defined in a cell.
"""

import io
import json
import warnings
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.execution.engines import Where
from benchmarks.pictures.figures import camera_of
from benchmarks.pictures.film import Camera
from benchmarks.report.words import conclusion
from benchmarks.report.writing import write_report
from benchmarks.scenarios import SCENARIOS
from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Axis, Sweep
from benchmarks.sweeps.results import Results, incomplete_sentence
from benchmarks.sweeps.running import Options, begun, check
from benchmarks.sweeps.suites import PAPER_METHODS, SUITES, sweeps_named
from benchmarks.tables.csv_files import results_csv, trials_csv
from benchmarks.tables.stats import Estimate
from benchmarks.trials.episode import Moment
from benchmarks.trials.spec import Method
from benchmarks.trials.stage import Stage
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError, one_of, shown
from localizers import Belief, register
from localizers.naming.registry import Factory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vary = Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Sequence[Any]]]
_SHOWN = ("error", "error_low", "error_high", "diff", "diff_low", "diff_high")  # in Jupyter


def sweep(
    of: str | Path | Sweep = "quick",
    *,
    localizers: Sequence[str | Method | Mapping[str, Any] | Factory] = (),
    vary: Vary = (),
    **changes: Any,
) -> "Experiment":
    """Return an experiment: settings and methods on paired worlds; nothing is run yet.

    Args:
        of: a suite or a scenario (``deqmcl list`` has both), a sweep file in TOML, or a ``Sweep``.
        localizers: instead of those of ``of``: names, classes or functions that make a localizer
            for a robot, or {"name": …, "params": {…}}. A scenario has the methods of the paper.
        vary: values by dotted name, as in ``{"params.particles": [100, 1000]}``; all combinations
            are run. Names that change together stand in one mapping of a list of them.
        changes: other fields of ``Sweep``: trials, seed, lag, world, assumed, params, baseline, ….

    Raises:
        InputError: an unknown name, or a bad value.
    """
    if isinstance(of, Sweep):
        base = of
    elif isinstance(of, str) and of in SCENARIOS and of not in SUITES:
        base = Sweep(title=of, scenario=of, localizers=tuple(map(_method, PAPER_METHODS)))
    else:
        name = str(of)
        if not name.endswith(".toml"):
            one_of("suite or scenario", name, {**SUITES, **SCENARIOS})
        base = sweeps_named(name)[""]
    if localizers:
        changes["localizers"] = tuple(map(_method, localizers))
        if base.baseline not in {one.name for one in changes["localizers"]}:
            changes.setdefault("baseline", "")
    if vary:
        axes = [{name: v} for name, v in vary.items()] if isinstance(vary, Mapping) else vary
        values = [Changes({name: tuple(v) for name, v in one.items()}) for one in axes]
        changes["vary"] = tuple(Axis(values=own) for own in values)
    try:
        return Experiment(replace(base, **changes))
    except TypeError as error:  # an unknown field
        raise InputError(f"{error}: give fields of Sweep, as in trials=20.") from None


@dataclass(frozen=True)
class Experiment:
    """A sweep that can be run.

    Attributes:
        sweep: its design.
    """

    sweep: Sweep

    def run(
        self, jobs: int | None = None, out: str | Path | None = None, *, progress: bool = True
    ) -> "ExperimentResults":
        """Run what is missing, and return all results.

        Args:
            jobs: trials at a time; None: one per processor.
            out: folder that keeps the trials, so that a second run goes on, as that of the command
                does; None: nothing is kept but the results.
            progress: show a bar.

        Raises:
            InputError: something of it is refused; nothing is run then.
        """
        check(self.sweep)
        options = Options(where=Where(jobs=jobs), progress=progress)
        with TemporaryDirectory() if out is None else nullcontext() as apart:
            folder = Path(out or f"{apart}/experiment")
            with begun(self.sweep, folder, options, command=["python"]) as running:
                return ExperimentResults(self.sweep, running.results())

    def __repr__(self) -> str:
        methods = ", ".join(map(str, self.sweep.localizers))
        return f"<Experiment {self.sweep.title!r}: {self.sweep.planned:,} trials of {methods}>"


@dataclass(frozen=True)
class ExperimentResults:
    """The numbers of an experiment; in Jupyter, its verdict and its first table.

    Attributes:
        sweep: what was run.
        results: all of it, for whom the tables are not enough.
    """

    sweep: Sweep
    results: Results

    @cached_property
    def table(self) -> pd.DataFrame:
        """results.csv: a row for each setting, method and offset; what was varied has columns."""
        panels = self.results.panels
        table = pd.read_csv(io.StringIO(results_csv(panels)))
        table.insert(0, "label", [panel.labels[r.method] for panel in panels for r in panel.rows])
        return _with_varied(table, self.sweep)

    @cached_property
    def trials(self) -> pd.DataFrame:
        """trials.csv: a row for each trial and offset; what was varied has columns."""
        table = pd.read_csv(io.StringIO(trials_csv(self.results.finished)))
        return _with_varied(table, self.sweep)

    def plot(self, over: str, value: str = "error", *, offset: int = 0) -> "Figure":
        """Draw a column of ``table`` over one that was varied, with its 95 % intervals.

        Args:
            over: column of the swept value, such as "particles".
            value: column with its interval in value_low and value_high.
            offset: of the state: 0 is x[t].

        Raises:
            InputError: there is no such column, or it has no numbers.
        """
        from benchmarks.pictures import styled
        from benchmarks.report.svg import HOUSE_STYLE, canvas, estimates, looks, picture

        table = self.table[self.table["offset"] == offset]
        for name in (over, value, f"{value}_low"):
            if name not in table or not pd.api.types.is_numeric_dtype(table[name]):
                numbers = table.select_dtypes("number").columns
                raise InputError(
                    f"there is no column {shown(name)} of numbers: it has {', '.join(numbers)}."
                )
        with styled(HOUSE_STYLE):
            labels = dict.fromkeys(table["label"])
            figure, axes = canvas(6.4, 3.4, legend_of=labels)
            for label, look in looks(labels).items():
                rows = table[(table["label"] == label) & table[over].notna()].sort_values(over)
                ends = rows[[value, f"{value}_low", f"{value}_high"]].itertuples(index=False)
                found = [Estimate(*one) for one in ends]
                estimates(axes, rows[over].tolist(), found, look, label)
            axes.set(xlabel=over, ylabel=value)
            axes.grid(color="#dddddd")
            return picture(figure, name="plot", title="", caption="", alt="").figure

    def report(self, out: str | Path) -> Path:
        """Write report.html and all tables into a folder; return the page."""
        write_report(Path(out), self.results)
        return Path(out) / "report.html"

    def __repr__(self) -> str:
        lines = [conclusion(self.results).text, incomplete_sentence(self.results)]
        return "\n".join(filter(None, lines))

    def _repr_html_(self) -> str:
        now = self.table[self.table["offset"] == 0]
        varied = [name for name in now.columns if now[name].nunique() > 1 and name in self._varied]
        first = now[["label", *varied, *_SHOWN]].round(3)
        return f"<p>{self!r}</p>{first.to_html(index=False)}"

    @property
    def _varied(self) -> list[str]:
        names = [name for axis in self.sweep.vary for name in axis.values]
        return [_column(name, names) for name in names]


class Step(NamedTuple):
    """A step of a run.

    Attributes:
        t: its number, from 0 (reset).
        truth: the true pose (x, y, θ).
        ranges: the scan, (B,).
        action: the command that led here; None at t = 0.
        plan: the planned actions that the localizer was shown, (h, 2); None: not known.
        belief: what the localizer believes after it.
        draw: returns a picture of it, (height, width, 3) uint8: past, present and future.
    """

    t: int
    truth: Reals
    ranges: Reals
    action: Reals | None
    plan: Reals | None
    belief: Belief
    draw: Callable[[], NDArray[np.uint8]]


def run(
    scenario: str, localizer: str | Factory, *, seed: int = 0, trial: int = 0, **params: Any
) -> Iterator[Step]:
    """Run one trial, and yield it step by step.

    Args:
        scenario: as in ``sweep``.
        localizer: a name, or what makes a localizer for a robot.
        seed, trial: the world is that of this trial of a sweep with this seed.
        params: of the localizer.

    Raises:
        InputError: an unknown name, or a bad value.
    """
    of = Sweep(
        title=scenario, scenario=scenario, localizers=(_method(localizer),), params=Changes(params),
        seed=seed, trials=trial + 1,
    )  # fmt: skip
    stage = Stage.of(of.distinct()[trial])
    camera = camera_of(stage)
    for moment in stage.moments():
        yield Step(
            moment.step, moment.truth, moment.ranges, moment.action, moment.plan, moment.belief,
            _drawing(camera, moment, str(of.localizers[0])),
        )  # fmt: skip


def _drawing(camera: Camera, moment: Moment, method: str) -> Callable[[], NDArray[np.uint8]]:
    return lambda: np.ascontiguousarray(camera.frame(moment, [f"{method}, t = {moment.step}"]))


def _method(given: str | Method | Mapping[str, Any] | Factory) -> Method:
    """Return a method; what makes localizers is registered by its name."""
    if isinstance(given, Method):
        return given
    if isinstance(given, Mapping):
        return Method(name=given["name"], params=given.get("params", {}))
    if isinstance(given, str):
        return Method(name=given)
    name = getattr(given, "__name__", None)
    if not callable(given) or not isinstance(name, str):
        raise InputError(
            f"the localizer is {shown(given)}, but must be a name, a class or a function."
        )
    with warnings.catch_warnings():  # a cell is run again
        warnings.simplefilter("ignore")
        register(name, given)
    return Method(name=name)


def _with_varied(table: pd.DataFrame, sweep: Sweep) -> pd.DataFrame:
    """Return a table with a column for each part of the world, assumption or parameter varied."""
    varied = [name for axis in sweep.vary for name in axis.values]
    for name in varied:
        group, _, rest = name.partition(".")
        if group in table and rest:
            # a method without the parameter stands beside those with it
            columns = ("swept", group) if "swept" in table and group == "params" else (group,)
            rows = zip(*(table[column].map(json.loads) for column in columns), strict=True)
            told = [ChainMap(*row).get(rest) for row in rows]
            table[_column(name, varied)] = told
    return table


def _column(name: str, varied: Sequence[str]) -> str:
    """Return the last part of a dotted name, or all of it where that is not one's own."""
    last = [other.rpartition(".")[2] for other in varied]
    short = name.rpartition(".")[2]
    return short if last.count(short) == 1 and short not in _SHOWN else name
