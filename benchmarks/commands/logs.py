"""Recorded logs: localizers replayed on one, what another stack made of one, and tuning on some."""

import argparse
import math
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import (
    JOBS,
    MCAP,
    RETRY_FAILED,
    TIMEOUT,
    Option,
    command,
    group,
    localizers_named,
    option,
    out,
    path,
    seed,
    settings,
    switch,
)
from benchmarks.console import doing, log_warnings, warn

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.robots import Replay
    from benchmarks.robots.nav2 import Amcl
    from benchmarks.robots.search import Task

_OF_LOGS = "world.…, assumed.… and params.… (docs/your-map-your-log.md)"  # that may be set
_NODE = option(
    "--node", metavar="NAME", help="the node in that file, as in /robot1/amcl (the only amcl)"
)
_LOG = option(
    "log", nargs="+", metavar="LOG", help="a ROS bag, or its parts; a CARMEN log, CSV or npz"
)
_MAP = option("--map", required=True, metavar="MAP.yaml", help="the map, as for ROS' map_server")
_FAIL_IF = option("--fail-if", action="append", default=[], metavar="'COLUMN > X'", help="end "
    "with exit code 4 if this is so of a row of results.csv, or its value unknown, as in "
    "'position_p95 > 0.2' or 'amcl.position_p95 > 0.2' for one row (one --fail-if each)",
)  # fmt: skip


def _every(default: str) -> Option:
    words = f"play a record each time the robot has moved this far ({default})"
    return option("--every", metavar="D,A", help=words)


def _nav2(words: str) -> Option:
    return option(
        "--nav2", type=Path, action="append", default=[], metavar="PARAMS.yaml", help=words
    )


@command(
    _LOG,
    _MAP,
    option("--reference", metavar="REF.tum", help="true poses in the map's frame (the log's own)"),
    option("--localizers", default="mcl,amcl", metavar="A,B,…", help="methods (mcl,amcl)"),
    option("--start", metavar="S", help="where the robot starts: reference, global, x,y,θ in m and "
        "rad, as in --start=1,2,0, room=x,y,x,y,…, near=x,y,within[,beyond], or a .toml file "
        "(reference, if there is one)"),
    _nav2("Nav2's parameter file: sets all of amcl, and for the others what is not set here; of "
        "several each has a row, the first is the baseline"),
    _NODE,
    _every("0.2m,5deg; with amcl 0.0625m,3deg, so that it updates as often as a robot's"),
    settings("assumed.scan.sigma=0.1 or world.max_beams=60", _OF_LOGS),
    option("--seeds", type=int, default=10, metavar="K", help="runs of each localizer (10)"),
    _FAIL_IF,
    JOBS,
    out(without="results/LOG"),
    group(
        "more",
        option("--particles", type=int, metavar="N", help="particles of all (each method's "
            "default: 1000; amcl: at most 2000); not of amcl with --nav2"),
        switch("--residuals", "also tell and draw where the map is wrong: cells that beams end in "
            "or pass though the map says otherwise"),
        seed(),
        TIMEOUT,
        switch("--dry-run", "print what would be run, as a sweep file with all that is set and "
            "fitted"),
        MCAP,
    ),
)  # fmt: skip
def replay_command(options: argparse.Namespace) -> str:
    """Play the same records of a log to every localizer, as fast as possible, and compare them.

    Writes tables, trajectories (TUM, for evo) and a page: docs/your-map-your-log.md.
    """
    from benchmarks.execution.engines import Where
    from benchmarks.report.laps import mcap_file, shown_again
    from benchmarks.report.runs import limits_of, within
    from benchmarks.robots.replaying import planned, run_replay, sweep_file
    from benchmarks.sweeps.running import Options, complete

    how = Options(where=Where(jobs=options.jobs, timeout=options.timeout))
    mcap = mcap_file(options.mcap)
    limits_of(options.fail_if)  # refused before anything is read
    names = ("reference", "start", "particles", "seeds", "seed")
    plan = planned(
        options.log,
        options.map,
        localizers_named(options.localizers),
        settings=_settings(options),
        nav2=_amcl(options),
        **{name: getattr(options, name) for name in names},
    )
    limits_of(options.fail_if, [method.shown for method in plan.sweep.localizers])
    if options.dry_run:
        return sweep_file(plan.sweep, [*plan.warnings, *plan.replay.facts]).rstrip()
    target = options.out or Path("results") / Path(options.log[0]).name.partition(".")[0]
    played = run_replay(plan, target, how, options.words, options.residuals, paged=True)
    text = complete(played.results, str(played))
    if mcap is not None:
        first = list(replace(plan.sweep, trials=1).distinct())
        with doing("playing the first run of each again, to show it"):
            shown_again(first, mcap)
        text += f"\n\nMCAP, the first run of each: {options.mcap}"
    return within(text, played.table, options.fail_if, plan.sweep.baseline)


def _amcl(options: argparse.Namespace) -> "list[Amcl]":
    from benchmarks.robots.nav2 import read_nav2
    from deqmcl_gym.validation import InputError

    if options.node is not None and not options.nav2:
        raise InputError("--node is given without --nav2: name the file that the node is in.")
    return [read_nav2(path, options.node) for path in options.nav2]


def _settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return what is set, ``--every`` among it."""
    from benchmarks.setup import documents
    from deqmcl_gym.validation import InputError

    values = documents.settings(options.set)
    if options.every is not None and "world.every" in values:
        raise InputError("--every is given, and world.every set: give one of them.")
    return values if options.every is None else values | {"world.every": options.every}


@command(
    option("estimates", nargs="+", metavar="THEIRS", help="an estimate, [NAME=]FILE[:TOPIC]: "
        "slam.tum, mine=poses.csv, run.mcap:/amcl_pose"),
    option("--reference", metavar="REF.tum", help="true poses in the map's frame"),
    option("--beside", type=path, metavar="DIR", help="a folder of deqmcl replay: its log, "
        "reference and map, and its rows in the table"),
    option("--log", metavar="LOG", help="score at the records of a log, as replay does"),
    option("--map", metavar="MAP.yaml", help="compare the log's scans with a map"),
    settings("world.reading.base_frame=base", "world.reading.…"),
    option("--every", metavar="D,A", help="score a record each time the robot has moved this far "
        "(0.2m,5deg)"),
    _FAIL_IF,
    out(),
)  # fmt: skip
def score_command(options: argparse.Namespace) -> str:
    """Score what another stack has estimated on a log, with the columns of ``deqmcl replay``.

    An estimate is a TUM file, a CSV with time,x,y,heading and perhaps covariances, or a topic of
    poses in a bag: docs/tune-on-your-log.md.
    """
    from benchmarks.report.runs import limits_of, within
    from benchmarks.robots import values_among
    from benchmarks.robots.estimates import estimates_of, played_before, played_by_replay, score
    from benchmarks.setup import documents
    from deqmcl_gym.logs import read_tum
    from deqmcl_gym.validation import InputError, one_of

    beside, log, reference = options.beside, options.log, options.reference
    names = ("map", "every", "set", "log", "reference")
    flags = [f"--{name}" for name in names if getattr(options, name)]
    if beside is not None and flags:
        raise InputError(
            f"{flags[0]} is given with --beside, whose folder says what was played: leave one of "
            "them out."
        )
    if log is None and flags and flags[0] != "--reference":
        raise InputError(f"{flags[0]} is given without --log: name the log that it is about.")
    if beside is None and not flags:
        raise InputError("there is nothing to score by: give --reference, --log or --beside.")
    limits_of(options.fail_if)  # refused before anything is read
    with doing("reading the estimates and what they are scored by"), log_warnings() as warnings:
        by: Any  # a log, or a reference alone
        if beside is not None:
            by = played_before(beside)
        elif log is not None:
            values = documents.settings(options.set)
            for name in values:
                if not name.startswith("world.reading."):
                    one_of("name of a setting of a log", name, ["world.reading.…"])
            reading = values_among(values, "world.reading.")
            by = played_by_replay(log, reference, reading, options.map, options.every)
        else:
            by = read_tum(reference)
        estimates = estimates_of(options.estimates)
        uncovered, text, table = score(by, estimates, options.out)
    warn([*warnings, *uncovered])
    return within(text, table, options.fail_if)


@command(
    _LOG,
    _MAP,
    option("--start", required=True, metavar="S", help="where the robot starts, as for replay: "
        "x,y,θ, global, …"),
    _every("0.2m,5deg"),
    settings("assumed.scan.power=0.1", "world.… and assumed.… (docs/your-map-your-log.md)"),
    option("--seeds", type=int, default=5, metavar="K", help="runs (5)"),
    option("--particles", type=int, default=1000, metavar="N", help="particles (1000)"),
    seed(),
    out(),
)  # fmt: skip
def smooth_command(options: argparse.Namespace) -> str:
    """Estimate all poses of a log from its scans, odometry and map, and say how good they are.

    Writes smoothed.csv, with covariances, and smoothed.tum, a --reference for replay, score and
    tune, but not if the log itself speaks against the poses: docs/your-map-your-log.md.
    """
    from benchmarks.robots.smoothing import smooth

    how = {name: getattr(options, name) for name in ("start", "particles", "seeds", "seed")}
    smoothed = smooth(options.log, options.map, settings=_settings(options), **how)
    files = ", ".join(path.name for path in smoothed.write(options.out))
    return f"{smoothed}\n\nWritten to {options.out}: {files}."


@command(
    option("logs", nargs="+", metavar="LOG", help="a CARMEN log, ROS bag, CSV or npz file, or "
        "several"),
    option("--map", action="append", default=[], metavar="MAP.yaml", help="the map; for several "
        "logs one for all, or one each in their order"),
    option("--reference", action="append", default=[], metavar="REF.tum", help="true poses in the "
        "map's frame (the log's own), as --map"),
    option("--localizer", default="amcl", metavar="NAME", help="what is tuned (amcl)"),
    option("--space", type=Path, metavar="FILE.toml", help="ranges, in place of the built-in ones"),
    option("--score", default="log-score", metavar="NAME", help="what is to be best: log-score (of "
        "the pose with its covariance), median, p95 (position error), localized, "
        "false-commitment (log-score)"),
    option("--max-ms", type=float, metavar="MS", help="most ms per step that the winner may take"),
    option("--candidates", type=int, default=108, metavar="N", help="how many candidates, in "
        "rounds of 18; more go on in the same folder (108)"),
    _nav2("your Nav2 parameters: the default to beat"),
    _NODE,
    settings("params.max_particles=500 or world.max_beams=60", _OF_LOGS),
    JOBS,
    out(),
    group(
        "segments",
        option("--segment", type=float, default=15.0, metavar="M", help="m driven in a segment "
            "(15)"),
        option("--gap", type=float, default=2.0, metavar="M", help="m driven between two (2)"),
        option("--start-sd", default="0.2m,0.1rad", metavar="D,A", help="how well the start of a "
            "segment is known, standard deviations (0.2m,0.1rad)"),
        _every("0.2m,5deg; for amcl 0.05m,3deg"),
    ),
    group("more", seed(), TIMEOUT, RETRY_FAILED),
)  # fmt: skip
def tune_command(options: argparse.Namespace) -> str:
    """Search the parameters of a localizer that are best on your logs, and say what is gained.

    Trains on some segments of the logs and tells the gain on others, which the search does not see;
    the same command resumes: docs/tune-on-your-log.md.
    """
    from benchmarks.execution.engines import Where
    from benchmarks.robots.search import GOALS, search
    from benchmarks.robots.tuned import write_tuned
    from benchmarks.sweeps.running import Options
    from deqmcl_gym.validation import InputError, integer, number, one_of

    name, *others = localizers_named(options.localizer) or ("", "")
    if others:
        raise InputError(f"--localizer is {options.localizer!r}, but must name one localizer.")
    one_of("score", options.score, GOALS)
    if options.max_ms is not None:
        number("--max-ms", options.max_ms, low=0, above=True)
    integer("--candidates", options.candidates, low=2, high=100_000)
    if options.nav2 and name != "amcl":
        raise InputError(f"--nav2 is given, but {name} is tuned: leave it out, or tune amcl.")
    if len(options.nav2) > 1:
        raise InputError("--nav2 is given twice, but there is one default to beat: give one.")
    nav2 = next(iter(_amcl(options)), None)
    task = _task(options, name, nav2)
    with doing("checking the segments and the ends of all ranges"):
        task.check()
    where = Where(jobs=options.jobs, timeout=options.timeout)
    how = Options(where=where, retry_failed=options.retry_failed, progress=False)
    tuning = search(task, options.out, how, options.candidates)
    file = None if nav2 is None else nav2.file
    return write_tuned(tuning, options.out, options.words, file, options.node)


def _task(options: argparse.Namespace, name: str, nav2: "Amcl | None") -> "Task":
    from benchmarks.robots import values_among
    from benchmarks.robots.nav2 import usual_params
    from benchmarks.robots.search import Task, cut
    from benchmarks.robots.space import space_of
    from benchmarks.setup.overrides import Overrides
    from benchmarks.sweeps.sweepfile import params_by_localizer
    from deqmcl_gym.envs.log import spacing
    from deqmcl_gym.validation import InputError, integer, number
    from localizers import parameters
    from localizers.methods.deq_mcl import Shared

    integer("--seed", options.seed)
    length = number("--segment", options.segment, low=0, above=True)
    gap = number("--gap", options.gap, low=0)
    sd = spacing("--start-sd", given := options.start_sd, "m")
    if not all(map(math.isfinite, sd)):
        raise InputError(f'--start-sd is {given!r}, but must have both, as in "0.5m,15deg".')
    params = params_by_localizer(values_among(_settings(options)), [name])[name]
    replays = _replays(options, name, nav2)
    noise = [n for n in vars(replays[0].motion) if n != "still"]
    base = Overrides({} if nav2 is None else nav2.params) | params
    space = space_of(options.space, name, noise, base)
    training, held_out = cut(replays, length, gap, sd, options.seed)
    taken = parameters(name) or ()
    setup = replays[0].scenario
    tempered = {"beta": setup.beta, "plan_beta": setup.beta}
    defaults = usual_params() if name == "amcl" else vars(Shared()) | tempered
    scan = {f"scan.{part}": value for part, value in vars(setup.scan).items()}
    known = {n: v for n, v in defaults.items() if n in taken and v is not None}
    usual = Overrides({**known, **scan, **training[0].assumed, **base})
    asked: dict[str, Any] = {n: getattr(options, n) for n in ("score", "max_ms", "seed")}
    asked |= {"base": base, "usual": usual, "space": space}
    return Task(localizer=name, training=training, held_out=held_out, **asked)


def _replays(options: argparse.Namespace, name: str, nav2: "Amcl | None") -> "list[Replay]":
    """Return the logs as the default would play them."""
    from benchmarks.robots import replay_of
    from benchmarks.robots.calibration import doubts_of, with_fitted_power
    from deqmcl_gym.validation import InputError

    files = [Path(log).resolve() for log in options.logs]
    for log, file in zip(options.logs, files, strict=True):
        if files.count(file) > 1:
            raise InputError(f"{log} is given twice: give each log once.")
    references = options.reference or [None]
    for flag, paths in {"--map": options.map, "--reference": references}.items():
        if len(paths) not in (1, len(files)):
            raise InputError(
                f"{flag} is given {len(paths)} times for {len(files)} logs: give it once, or once "
                "for each log, in their order."
            )
    usual: dict[str, Any] = {}
    if name == "amcl":
        usual = {"world.every": "0.05m,3deg", "world.max_beams": 180}
    if nav2 is not None:
        usual |= nav2.settings
    settings = usual | _settings(options)
    with doing("reading the logs and the maps"), log_warnings() as warnings:
        each = zip(options.logs, cycle(options.map), cycle(references), strict=False)
        replays = [
            replay_of(log, floor_plan, reference=reference, otherwise="global", settings=settings)
            for log, floor_plan, reference in each
        ]
    for replay, log in zip(replays, options.logs, strict=True):
        if not replay.log.referenced.size:
            raise InputError(f"{log} has no reference, so no error is known: give --reference.")
    notes = [] if nav2 is None else nav2.notes
    sideways = [replay.sideways for replay in replays]
    doubts = [doubt for replay in replays for doubt in doubts_of(replay.scenario)]
    warn([*warnings, *notes, *sideways, *doubts])
    if {replay.log.unit for replay in replays} != {"m"}:
        raise InputError("a log is in px, but tune takes logs in m: give another one.")
    return replays if name == "amcl" else [with_fitted_power(replay) for replay in replays]
