"""``deqmcl replay``: a sweep over runs of localizers on one log, with tracks and its own CSV."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.console import doing, log_warnings, warn
from benchmarks.execution.engines import Where
from benchmarks.experiment import as_toml, knowing, named_localizers
from benchmarks.report.page import no_report, page_files
from benchmarks.report.runs import ended, runs_frame, tracks_table, tracks_trials
from benchmarks.report.tracks import accuracy, differences_table, published, tables_of
from benchmarks.report.verdict import conclusion
from benchmarks.robots import EVERY, OFTEN, SCENARIO, Replay, calibration, replay_of, values_among
from benchmarks.robots.nav2 import Amcl, read_nav2
from benchmarks.robots.residuals import PICTURE, TABLE, residuals_of
from benchmarks.setup.documents import sweep_text
from benchmarks.setup.overrides import NOTHING, Overrides, file_names
from benchmarks.sweeps import Sweep
from benchmarks.sweeps.results import Results
from benchmarks.sweeps.running import Options, begun, check
from benchmarks.sweeps.store import write_files
from benchmarks.sweeps.sweepfile import check_localizers, params_by_localizer
from benchmarks.tables import file_words, short_names
from benchmarks.tables.frames import csv_of
from benchmarks.trials import Method
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Trajectory
from deqmcl_gym.validation import InputError, integer
from localizers import parameters
from localizers.methods.deq_mcl import Shared
from localizers.registry import Factory

_TRACKS = "tracks"
_RUNS = (
    "Intervals and tests over runs tell what other seeds would give on this log, not other logs."
)


@dataclass(frozen=True)
class Planned:
    """Runs of localizers on a log, not begun."""

    replay: Replay  # what is played
    sweep: Sweep  # whose worlds are the runs of each localizer
    warnings: list[str]  # about the log and Nav2's file, as printed


def planned(
    log: str | Path | Sequence[str | Path],
    floor_plan: str | Path,
    localizers: Sequence[str] = ("mcl", "amcl"),
    *,
    reference: str | Path | None = None,
    start: str | Sequence[float] | None = None,
    settings: Mapping[str, Any] = NOTHING,
    particles: int | None = None,
    seeds: int = 10,
    seed: int = 0,
    nav2: Sequence[Amcl] = (),
) -> Planned:
    """Read a log, fit what is not set, and return the runs of localizers on it, checked.

    Log, map, reference, start and ``settings`` are as for ``replay_of``, with params.KEY of all
    localizers and params.LOCALIZER.KEY of one; ``nav2`` sets all of ``amcl``, and what is not in
    them; of several each is an ``amcl`` of its own, and the first sets what is shared. The first
    localizer is the baseline, or the first of several ``amcl``; each has ``seeds`` runs, and takes
    ``particles`` by whatever name it has for them; None: its own default.
    """
    usual: dict[str, Any] = {"world.every": OFTEN if "amcl" in localizers else EVERY}
    if nav2:  # records as often, and beams as many, as any file needs
        usual = nav2[0].settings
        usual["world.every"] = tuple(map(min, zip(*(file.every for file in nav2), strict=True)))
        usual["world.max_beams"] = max(file.params["max_beams"] for file in nav2)
    with doing("reading the log and the map"), log_warnings() as reader_warnings:
        replay = replay_of(
            log,
            floor_plan,
            reference=reference,
            start=start,
            otherwise=nav2[0].start if nav2 else None,
            settings=usual | dict(settings),
        )
    warnings = warn(reader_warnings)  # whatever fails later
    params = params_by_localizer(values_among(settings), localizers)
    replay = calibration.judged_after_part(replay)
    if any(name != "amcl" or v.get("laser_model_type") == "robot" for name, v in params.items()):
        replay = calibration.with_fitted_power(replay)
    sweep = replay_sweep(replay, methods_of(localizers, particles, params, nav2), seeds, seed)
    check(sweep)
    warnings += warn(gated(sweep, settings.get("world.every")))
    for file in nav2:
        warnings += warn(file.notes)
        if "amcl" not in params:
            continue
        amcl = {**file.params, **params["amcl"]}
        warnings += warn(file.differences(amcl, replay))
        if particles is not None:
            sizes = f"has the file's, {amcl['min_particles']} to {amcl['max_particles']}"
            remedy = "--set params.amcl.max_particles=… makes the comparison fair"
            warnings += warn([f"--particles {particles} is not of amcl, which {sizes}: {remedy}"])
    return Planned(replay, sweep, warnings)


def replay_sweep(replay: Replay, methods: tuple[Method, ...], seeds: int, root: int) -> Sweep:
    """Return the sweep whose worlds are the runs of each localizer on a log."""
    integer("--seeds", seeds, low=1, high=10_000)
    return Sweep(
        title=f"Replay of {file_names(replay.world['log'])}",
        localizers=methods,
        scenario=SCENARIO,
        lag=0,
        world=replay.world,
        assumed=replay.assumed,
        seed=root,
        trials=seeds,
        baseline=next((method.label for method in methods if method.label), methods[0].name),
        takes=lambda _: (),  # each is given its own parameters, and no lag
    )


def sweep_file(sweep: Sweep, notes: Sequence[str] = ()) -> str:
    """Return a sweep over a log as a sweep file, with comments before it."""
    methods = []
    for method in sweep.localizers:
        lag = {"lag": Shared.lag} if "lag" in (parameters(method.name) or ()) else {}
        methods.append(method.json() | {"params": {**lag, **method.params}})
    top = {"title": sweep.title, "scenario": sweep.scenario, "lag": sweep.lag}
    top |= {"seed": sweep.seed, "trials": sweep.trials, "baseline": sweep.baseline}
    tables = {"world": sweep.world, "assumed": sweep.assumed}
    return sweep_text(notes, top | {"localizers": methods}, tables)


def gated(sweep: Sweep, every: str | None) -> list[str]:
    """Return the note that ``amcl`` will update less often than on a robot; none if it will not."""
    waits = [method.params.keys() for method in sweep.localizers if method.name == "amcl"]
    if every is None or not waits or {"update_min_d", "update_min_a"} & waits[0]:
        return []
    limits = zip(spacing("--every", every, "m"), spacing("every", OFTEN, "m"), strict=True)
    if all(asked <= often for asked, often in limits):
        return []
    return [
        "amcl updates when the robot has moved 0.25 m or turned 0.2 rad, as Nav2's does, but only "
        f"records {every} apart are played, so it may update less often than on a robot: leave out "
        f"--every, which is {OFTEN} then, or give --set params.amcl.update_min_d=0 --set "
        "params.amcl.update_min_a=0 to update at each record."
    ]


@dataclass(frozen=True)
class ReplayResults:
    """What came of runs on a log; ``str`` of it is what the command prints."""

    runs: pd.DataFrame  # a row per run, with its track
    table: pd.DataFrame  #: results.csv: a row for each localizer
    trials: pd.DataFrame  #: trials.csv: a row for each run
    results: Results
    text: str

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return self.text.partition("\n\n")[0]

    def _repr_html_(self) -> str:
        return f"<p>{self!r}</p>{tables_of(self.runs)[0].frame.to_html(index=False)}"


def replay(
    log: str | Path | Sequence[str | Path],
    map: str | Path,  # noqa: A002 - as LogEnv has it
    *,
    localizers: Sequence[str | Factory] = ("mcl", "amcl"),
    settings: Mapping[str, Any] = NOTHING,
    nav2: str | Path | Sequence[str | Path] = (),
    node: str | None = None,
    out: str | Path | None = None,
    jobs: int | None = None,
    timeout: float | None = None,
    residuals: bool = False,
    command: Sequence[str] = ("python",),
    **how: Any,
) -> ReplayResults:
    """Play the records of a log to localizers, and return how far off each was.

    What is refused raises ``InputError`` before anything is run.

    Args:
        localizers: names, classes or functions that make one; the first is the baseline.
        settings: single values by dotted name, as ``--set`` has them: world.…, assumed.…, params.….
        nav2: Nav2's parameter file, with the ``node`` in it: sets all of ``amcl``, and for the
            others what is not set; of several each has a row, ``amcl (FILE)``.
        out: folder that keeps runs, tracks, tables and page; None: nothing is kept.
        jobs, timeout: see ``Where``.
        command: the words that started it, for the folder.
        how: reference, start, particles, seeds, seed: see ``planned``.
    """
    names, factories = named_localizers(localizers)
    files = [nav2] if isinstance(nav2, str | Path) else nav2
    amcl = [read_nav2(Path(file), node) for file in files]
    options = Options(where=Where(jobs=jobs, timeout=timeout))
    with knowing(factories), ExitStack() as stack:
        folder = Path(out or f"{stack.enter_context(TemporaryDirectory())}/replay")
        plan = planned(log, map, names, settings=as_toml(settings), nav2=amcl, **how)
        return run_replay(plan, folder, options, command, residuals, paged=out is not None)


def run_replay(
    plan: Planned, out: Path, options: Options, command: Sequence[str], residuals: bool, paged: bool
) -> ReplayResults:
    """Run what is missing, write the folder, with pictures if ``paged``, and return all of it.

    A folder that holds what is not of this sweep is refused; if a run failed, what the others gave
    is written all the same.
    """
    replay, methods, drawn = plan.replay, plan.sweep.localizers, paged and no_report() is None
    with begun(plan.sweep, out, options, command) as running:
        doubts = [replay.sideways, *calibration.doubts_of(replay.scenario), touches(replay)]
        shown = [*plan.warnings, *warn(doubts)]
        results = running.results()
        records = {m.shown: [r for r in results.records if r.trial.method == m] for m in methods}
        failures = [failure.trial.method for failure in results.failures]
        failed = {method.shown: failures.count(method) for method in methods}
        runs = runs_frame(records, failed, replay.log)
        if not replay.log.referenced.size and len(done := ended(runs)):
            where = "from the poses that the best run estimates"
            agreed, scanner = max(done["agreement_03"]), replay.log.scanner
            shown += warn([calibration.misfit_words(agreed, where, scanner)])
        wrong = residuals_of(replay, runs) if residuals else None
        said, facts = [*accuracy(runs), replay.overview], [*replay.facts, *published(runs)]
        with doing(f"writing the report in {out}" if paged else "scoring the runs"):
            table, trials = tracks_table(runs, results.table), tracks_trials(runs)
            contents = {
                "results.csv": utf8(csv_of(table)),
                "trials.csv": utf8(csv_of(trials)),
                **_tracks(replay, runs),
                **({} if wrong is None else wrong.files(drawn=drawn)),
            }
            if drawn and results.panels:
                notes, more = [*said, _RUNS], [] if wrong is None else [wrong.part]
                page = page_files(
                    results, Path(), notes=notes, warnings=shown, facts=facts, more=more
                )
                contents["report.html"] = page["report.html"]
            for name in (PICTURE, TABLE):  # of a run with --residuals
                (out / name).unlink(missing_ok=True)
            files = write_files(out, contents)
    differences = [*filter(None, map(differences_table, results.panels))]
    first, *others = tables_of(runs)
    texts = [conclusion(results), *said, *([] if wrong is None else [wrong.said])]
    texts += [*(each.text() for each in (first, *differences, *others)), *facts]
    names = ", ".join(path.name for path in files if path.parent == out)
    texts += [f"Written to {out}: {names} and {_TRACKS}/."] if paged else []
    texts += [f"Tables only: {no_report()}"] if paged and not drawn else []
    return ReplayResults(runs, table, trials, results, "\n\n".join(texts))


def touches(replay: Replay) -> str | None:
    """Return the warning that the reference itself touches walls; None if it does not."""
    log, floor_plan = replay.scenario.recording()
    poses = np.empty((0, 3)) if log.reference is None else log.reference[log.referenced]
    radius = replay.scenario.room().radius
    inside = ~floor_plan.free(poses[:, :2], radius)
    if not inside.any():
        return None
    return (
        f"{np.count_nonzero(inside):,} of {inside.size:,} poses of the reference touch walls of "
        f"the map, with a radius of {radius:g} {log.unit}: methods that charge collisions pay "
        "there; give the robot's --set world.radius=…, or mend the map."
    )


def _tracks(replay: Replay, runs: pd.DataFrame) -> dict[str, bytes]:
    """Return the trajectories of all runs, and the reference, as TUM files by name."""
    log, at, files = replay.log, replay.log.referenced, {}
    if log.reference is not None and at.size:
        files[f"{_TRACKS}/reference.tum"] = Trajectory(log.times[at], log.reference[at]).tum
    labels = list(runs["label"].unique())
    names = dict(zip(labels, file_words(labels), strict=True))
    done = ended(runs)
    for label, seed, track in zip(done["label"], done["seed"], done["track"], strict=True):
        files[f"{_TRACKS}/{names[label]}-{seed}.tum"] = Trajectory(log.times, track.best).tum
    return files


def methods_of(
    localizers: Sequence[str],
    particles: int | None,
    own: Mapping[str, Mapping[str, Any]],
    nav2: Sequence[Amcl] = (),
) -> tuple[Method, ...]:
    """Return localizers with ``own`` parameters, else of ``nav2``, else so many particles."""
    check_localizers(localizers)
    if len(nav2) > 1 and "amcl" not in localizers:
        raise InputError(f"--nav2 is given {len(nav2)} times without amcl: add it to --localizers.")
    files = {str(file.file.with_suffix("")): file for file in nav2}
    if len(files) < len(nav2):
        raise InputError(f"--nav2 names a file twice, of {', '.join(files)}: give each once.")
    short, methods, sizes = short_names(files), list[Method](), dict[str, int]()
    if particles is not None:
        integer("--particles", particles, low=1)
        sizes = dict.fromkeys(("particles", "max_particles"), particles)
        sizes["min_particles"] = min(particles, 500)
    for name in localizers:
        sets: dict[Overrides, list[str]] = {}  # files of one and the same parameters are one row
        for path, file in files.items() if name == "amcl" else ():
            sets.setdefault(Overrides(file.params) | own.get(name, {}), []).append(short[path])
        if not sets:
            taken = parameters(name) or ()
            usual = Overrides({key: n for key, n in sizes.items() if key in taken})
            sets[usual | own.get(name, {})] = []
        for params, sources in sets.items():
            label = f"{name} ({' = '.join(sources)})" if sources and len(files) > 1 else ""
            methods.append(Method(name, params, label=label))
    return tuple(methods)
