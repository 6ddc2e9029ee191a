"""Localizers compared, ``benchmarks.sweep(…).run(…)``, or watched, ``benchmarks.run(…)``.

A localizer may be a class or a function that is defined in a notebook's cell.
"""

import json
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd

from benchmarks.console import checking
from benchmarks.execution.engines import Where
from benchmarks.report.films import camera_of
from benchmarks.report.page import write_report
from benchmarks.report.verdict import conclusion
from benchmarks.setup.overrides import NOTHING, Named, Overrides
from benchmarks.sweeps import Sweep
from benchmarks.sweeps.results import Results, incomplete_sentence, summary
from benchmarks.sweeps.running import Options, Running, begun, check, shard_of
from benchmarks.sweeps.sweepfile import refuse_idle, sweep_named, sweep_of, with_settings
from benchmarks.tables.comparison import FURTHER, RESULTS
from benchmarks.tables.frames import INNER, trials_frame
from benchmarks.trials import Method
from benchmarks.trials.episode import Step
from benchmarks.trials.stage import Stage
from deqmcl_gym.validation import InputError, amount, integer, shown
from localizers import registered
from localizers.registry import Factory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TAKEN = {"label", *RESULTS, *trials_frame([])} - {"scenario", "lag"}
_SHOWN = ("error", "error_low", "error_high", "diff", "diff_low", "diff_high")  # in Jupyter


def sweep(
    of: str | Path | Sweep = "quick",
    *,
    localizers: Sequence[str | Method | Mapping[str, Any] | Factory] = (),
    vary: Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Sequence[Any]]] = (),
    settings: Mapping[str, Any] = NOTHING,
    **keys: Any,
) -> "Experiment":
    """Return an experiment: settings and methods on paired worlds; nothing is run yet.

    An unknown name or a bad value raises ``InputError``.

    Args:
        of: a suite or a scenario (``deqmcl list`` has both), a sweep file in TOML, or a ``Sweep``.
        localizers: instead of those of ``of``: names, classes or functions that make a localizer
            for a robot, or {"name": …, "params": {…}}. A scenario has the methods of the paper.
        vary: values by dotted name, as in ``{"params.particles": [100, 1000]}``; all combinations
            are run. Names that change together stand in one mapping of a list of them.
        settings: single values by dotted name, as the commands' ``--set`` has them:
            ``{"params.mcl.particles": 300, "world.lidar.beams": 9}``.
        keys: others of a sweep file: trials, seed, lag, world, assumed, params, baseline, ….
    """
    listed, factories = named_localizers(localizers or ())
    document = as_toml(keys) | ({"localizers": as_toml(listed)} if listed else {})
    if vary:
        axes = [{name: v} for name, v in vary.items()] if isinstance(vary, Mapping) else vary
        document["vary"] = as_toml(axes)
    with knowing(factories):
        base = of if isinstance(of, Sweep) else sweep_named(str(of))
        made = sweep_of(document, title=base.title, base=base)
        if localizers and "baseline" not in document and base.baseline not in made.names:
            made = replace(made, baseline="")
        made = with_settings(made, as_toml(settings))
        refuse_idle(made)
    return Experiment(made, factories)


@dataclass(frozen=True)
class Experiment:
    """A sweep that can be run, and what makes those of its localizers that are no names."""

    sweep: Sweep
    factories: Mapping[str, Factory] = field(default_factory=dict)

    def run(
        self,
        jobs: int | None = None,
        out: str | Path | None = None,
        *,
        dask: str | None = None,
        timeout: float | None = None,
        shard: str | None = None,
        retry_failed: bool = False,
        report: bool = False,
        progress: bool = True,
        command: Sequence[str] = ("python",),
    ) -> "ExperimentResults":
        """Run what is missing, and return all results.

        For ``jobs``, ``dask`` and ``timeout`` see ``Where``, for ``retry_failed`` and ``progress``
        see ``Options``. What is refused raises ``InputError`` before anything is run.

        Args:
            out: folder that keeps the trials, so that a second run goes on; None: only the results.
            shard: "i/n" runs every n-th trial, from the i-th.
            report: write tables and page into the folder.
            command: the words that started it, for the folder.
        """
        where = Where(jobs=jobs, dask=dask, timeout=timeout)
        part = None if shard is None else shard_of(shard)
        options = Options(where=where, shard=part, retry_failed=retry_failed, progress=progress)
        where.check()
        with ExitStack() as stack:
            folder = Path(out or f"{stack.enter_context(TemporaryDirectory())}/experiment")
            running = stack.enter_context(self.begun(folder, options, command))
            results = running.results()
            files = write_report(folder, results) if report else []
            text = summary(self.sweep, results, folder, files) if report else ""
            return ExperimentResults(self.sweep, results, text)

    @contextmanager
    def begun(self, out: Path, options: Options, command: Sequence[str]) -> Iterator[Running]:
        """Check it and open its folder, which is held until the block ends; nothing is run yet."""
        with knowing(self.factories):
            with checking() if options.progress else nullcontext():
                check(self.sweep)
            with begun(self.sweep, out, options, command) as running:
                yield running

    def __repr__(self) -> str:
        methods = ", ".join(map(str, self.sweep.localizers))
        with knowing(self.factories):
            trials = amount(self.sweep.planned, "trial")
        return f"<Experiment {self.sweep.title!r}: {trials} of {methods}>"


@dataclass(frozen=True)
class ExperimentResults:
    """The numbers of an experiment; in Jupyter, its verdict and its first table."""

    sweep: Sweep
    results: Results  #: all of it, for whom the tables are not enough
    text: str = ""  #: how far it is and what was written, if a report was

    @cached_property
    def table(self) -> pd.DataFrame:
        """results.csv: a row for each setting, method and offset; what was varied has columns."""
        table = self.results.table
        exact = [name for name in table if name not in FURTHER]
        return _with_varied(table[["label", *exact]].copy(), self.sweep)

    @cached_property
    def trials(self) -> pd.DataFrame:
        """trials.csv: a row for each trial and offset; what was varied has columns."""
        table = trials_frame(self.results.records).drop(columns=[*INNER])
        return _with_varied(table, self.sweep)

    def plot(self, over: str, value: str = "error", *, offset: int = 0) -> "Figure":
        """Draw a column of ``table`` over one that was varied, with 95 % intervals if it has any.

        Columns are such as "particles" and "error", with error_low and error_high. One that is not
        there, or has no numbers, raises ``InputError``.
        """
        from benchmarks.report.charts import Chart, line, styled

        table = self.table[self.table["offset"] == offset]
        if table.empty:
            raise InputError(f"no trial with a state at offset {offset} is finished.")
        for name in (over, value):
            if name not in table or not pd.api.types.is_numeric_dtype(table[name]):
                numbers = table.select_dtypes("number").columns
                raise InputError(
                    f"there is no column {shown(name)} of numbers: it has {', '.join(numbers)}."
                )
        others = [name for name in self._varied if name != over and table[name].nunique() > 1]
        labels = table["label"].astype(str)
        for name in others:
            labels = labels + f", {name} = " + table[name].map(str)
        rows = table.assign(label=labels)[table[over].notna()].sort_values(over, kind="stable")
        ends = [f"{value}_low", f"{value}_high"] if f"{value}_low" in rows else []
        with styled():
            axes = line(rows, over, value, *ends)
            axes.set(xlabel=over, ylabel=value)
        figure = cast("Figure", axes.figure)
        # a notebook shows it as the value of a cell, whatever its backend
        vars(figure)["_repr_png_"] = partial(Chart("", "", "", figure).drawn, "png")
        return figure

    def report(self, out: str | Path) -> Path:
        """Write report.html and all tables into a folder; return the page."""
        write_report(out, self.results)
        return Path(out) / "report.html"

    def __str__(self) -> str:
        """Return what the command prints."""
        return f"{self.text}\n{conclusion(self.results)}" if self.text else repr(self)

    def __repr__(self) -> str:
        lines = [conclusion(self.results), incomplete_sentence(self.results)]
        return "\n".join(filter(None, lines))

    def _repr_html_(self) -> str:
        now = self.table[self.table["offset"] == 0]
        varied = [name for name in self._varied if now[name].nunique() > 1]
        first = now[["label", *varied, *_SHOWN]].round(3)
        return f"<p>{self!r}</p>{first.to_html(index=False, na_rep='')}"

    @property
    def _varied(self) -> list[str]:
        """Columns of what was varied, in the order of the axes."""
        return [column for column in _columns(self.sweep).values() if column in self.table]


def run(
    scenario: str, localizer: str | Factory, *, seed: int = 0, trial: int = 0, **params: Any
) -> Iterator[Step]:
    """Run one trial, and yield it step by step: the world is that of this trial of a sweep.

    The sweep has this scenario and seed. An unknown name or a bad value raises ``InputError``.
    """
    integer("trial", trial)
    (name,), factories = named_localizers(localizer)
    with knowing(factories):
        method = Method(name, Overrides(as_toml(params)))
        world: dict[str, Any] = {"scenario": scenario, "seed": seed, "trials": trial + 1}
        of = Sweep(title=scenario, localizers=(method,), **world)
        stage = Stage.of(of.distinct()[trial])
        camera, title = camera_of(stage), str(method)
        for step in stage.moments():
            yield step._replace(draw=partial(camera.frame, step, [f"{title}, t = {step.t}"]))


def named_localizers(localizers: Any) -> tuple[list[Any], dict[str, Factory]]:
    """Return one or more localizers, classes and functions by their names, and these by name."""
    single = isinstance(localizers, str) or callable(localizers)
    names, factories = [], dict[str, Factory]()
    for localizer in [localizers] if single else localizers:
        made_by = localizer.func if isinstance(localizer, partial) else localizer
        name = getattr(made_by, "__name__", None)
        if isinstance(localizer, str | Method | Mapping):
            names.append(localizer)
        elif not isinstance(name, str) or name == "<lambda>":
            raise InputError(
                f"the localizer is {shown(localizer)}, but must be a name, a class or a function "
                'with a name, or {"name": …, "params": {…}} with one that is registered.'
            )
        elif factories.setdefault(name, localizer) is not localizer:
            raise InputError(f"two localizers are called {name}: give one of them another name.")
        else:
            names.append(name)
    return names, factories


@contextmanager
def knowing(factories: Mapping[str, Factory]) -> Iterator[None]:
    """Know localizers by these names in a ``with`` block."""
    with ExitStack() as stack:
        for name, factory in factories.items():
            stack.enter_context(registered(name, factory))
        yield


def as_toml(value: Any) -> Any:
    """Return a value as TOML has it: Python's numbers, lists and dicts."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Named):
        return {"name": value.name, "params": as_toml(value.params)}
    if isinstance(value, Mapping):
        return {name: as_toml(item) for name, item in value.items()}
    return [as_toml(item) for item in value] if isinstance(value, list | tuple | range) else value


def _with_varied(table: pd.DataFrame, sweep: Sweep) -> pd.DataFrame:
    """Return a table with a column for each part of the world, assumption or parameter varied."""
    for name, column in _columns(sweep).items():
        group, _, rest = name.partition(".")
        if group in table and rest:
            # a method without the parameter stands beside those with it
            parts = ("swept", group) if "swept" in table and group == "params" else (group,)
            rows = zip(*(table[part].map(json.loads) for part in parts), strict=True)
            table[column] = [ChainMap(*row).get(rest) for row in rows]
    return table


def _columns(sweep: Sweep) -> dict[str, str]:
    """The last part of each name that is varied, or all of it where that is another's, too."""
    last = [name.rpartition(".")[2] for name in sweep.varied]
    taken = _TAKEN | {short for short in last if last.count(short) > 1}
    return {n: n if s in taken else s for n, s in zip(sweep.varied, last, strict=True)}
