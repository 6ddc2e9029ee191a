"""Search the parameters of a localizer that are best on your logs, and say what is gained.

Trains on some segments of the logs and tells the gain on others, which the search does not see;
the same command resumes: docs/tune-on-your-log.md.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import shared
from benchmarks.commands.replay import OF_LOGS, add_every, add_nav2, nav2_of, settings_of
from benchmarks.console import doing, log_warnings, warn

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.robots.nav2 import Amcl
    from benchmarks.robots.played import Replay
    from benchmarks.robots.search import Task


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("logs", nargs="+", metavar="LOG", help="a CARMEN log, ROS bag, CSV or npz file, or several")
    for name, metavar, words in (
        ("--map", "MAP.yaml", "the map; for several logs one for all, or one each in their order"),
        ("--reference", "REF.tum", "true poses in the map's frame (the log's own), as --map"),
    ):
        add(name, action="append", default=[], metavar=metavar, help=words)
    add("--localizer", default="amcl", metavar="NAME", help="what is tuned (amcl)")
    add("--space", type=Path, metavar="FILE.toml", help="ranges, in place of the built-in ones")
    add(
        "--score",
        default="log-score",
        metavar="NAME",
        help="what is to be best: log-score (of the pose with its covariance), median, p95 "
        "(position error), localized, false-commitment (log-score)",
    )
    add("--max-ms", type=float, metavar="MS", help="most ms per step that the winner may take")
    add(
        "--candidates", type=int, default=108, metavar="N", help="how many candidates, in rounds "
        "of 18; more go on in the same folder (108)",
    )  # fmt: skip
    add_nav2(parser, "your Nav2 parameters: the default to beat")
    shared.add_set(parser, "params.max_particles=500 or world.max_beams=60", OF_LOGS)
    shared.add_jobs(parser, "runs")
    shared.add_out(parser)
    segments = parser.add_argument_group("segments")
    add = segments.add_argument
    add("--segment", type=float, default=15.0, metavar="M", help="m driven in a segment (15)")
    add("--gap", type=float, default=2.0, metavar="M", help="m driven between two (2)")
    add(
        "--start-sd",
        default="0.2m,0.1rad",
        metavar="D,A",
        help="how well the start of a segment is known, standard deviations (0.2m,0.1rad)",
    )
    add_every(segments, "0.2m,5deg; for amcl 0.05m,3deg")
    more = parser.add_argument_group("more")
    shared.add_seed(more)
    shared.add_timeout(more, "run")
    more.add_argument("--retry-failed", action="store_true", help="run again what failed before")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.engines import Where
    from benchmarks.robots.search import GOALS, searching
    from benchmarks.robots.tuned import write_tuned
    from benchmarks.sweeps.running import Options
    from deqmcl_gym.validation import InputError, integer, number, one_of

    named = shared.localizers_named(options.localizer)
    if len(named) != 1:
        raise InputError(f"--localizer is {options.localizer!r}, but must name one localizer.")
    (name,) = named
    one_of("score", options.score, GOALS)
    if options.max_ms is not None:
        number("--max-ms", options.max_ms, low=0, above=True)
    integer("--candidates", options.candidates, low=2, high=100_000)
    if options.nav2 is not None and name != "amcl":
        raise InputError(f"--nav2 is given, but {name} is tuned: leave it out, or tune amcl.")
    nav2 = nav2_of(options)
    where = Where(jobs=options.jobs, timeout=options.timeout)
    task = _task(options, name, nav2)
    with doing("checking the segments and the ends of all ranges"):
        task.check()
    how = Options(where=where, retry_failed=options.retry_failed, progress=False)
    with searching(task, options.out, how) as search:
        tuning = search.run(options.candidates)
        return write_tuned(tuning, options.out, options.words, options.nav2, options.node)


def _task(options: argparse.Namespace, name: str, nav2: "Amcl | None") -> "Task":
    """Return what is searched for, of the options."""
    from benchmarks.robots.nav2 import usual_params
    from benchmarks.robots.played import length_and_angle, params_among
    from benchmarks.robots.search import Task, cut
    from benchmarks.robots.space import space_of
    from benchmarks.setup.overrides import Overrides
    from benchmarks.sweeps.sweepfile import params_by_localizer
    from deqmcl_gym.validation import integer, number
    from localizers import parameters
    from localizers.methods.deq_mcl import Shared

    seed = integer("--seed", options.seed)
    length = number("--segment", options.segment, low=0, above=True)
    gap = number("--gap", options.gap, low=0)
    sd = length_and_angle("--start-sd", options.start_sd)
    own = params_by_localizer(params_among(settings_of(options)), [name])[name]
    replays = _replays(options, name, nav2)
    noise = [one for one in vars(replays[0].motion) if one != "still"]
    base = Overrides({} if nav2 is None else nav2.params) | own
    space = space_of(options.space, name, noise, base)
    training, held_out = cut(replays, length, gap, sd, seed)
    taken = parameters(name) or ()
    setup = replays[0].scenario
    tempered = {"beta": setup.beta, "plan_beta": setup.beta}
    defaults = usual_params() if name == "amcl" else vars(Shared()) | tempered
    scan = {f"scan.{part}": value for part, value in vars(setup.scan).items()}
    usual = {n: v for n, v in defaults.items() if n in taken and v is not None}
    return Task(
        localizer=name,
        base=base,
        usual=Overrides({**usual, **scan, **training[0].assumed, **base}),
        space=space,
        training=training,
        held_out=held_out,
        score=options.score,
        max_ms=options.max_ms,
        seed=seed,
    )


def _replays(options: argparse.Namespace, name: str, nav2: "Amcl | None") -> "list[Replay]":
    """Return the logs as the default would play them."""
    from benchmarks.robots.calibration import calibrated
    from benchmarks.robots.played import replay_of
    from benchmarks.robots.replaying import disagreement
    from deqmcl_gym.validation import InputError

    files = [Path(log).resolve() for log in options.logs]
    for log, file in zip(options.logs, files, strict=True):
        if files.count(file) > 1:
            raise InputError(f"{log} is given twice: give each log once.")
    maps = _each("--map", options.map, options.logs)
    references = _each("--reference", options.reference or [None], options.logs)
    usual: dict[str, Any] = {}
    if name == "amcl":
        usual = {"world.every": "0.05m,3deg", "world.max_beams": 180}
    if nav2 is not None:
        usual |= nav2.assumed | nav2.bounds
    settings = usual | settings_of(options)
    with doing("reading the logs and the maps"), log_warnings() as warnings:
        each = zip(options.logs, maps, references, strict=True)
        replays = [
            replay_of(log, floor_plan, reference=reference, otherwise="global", settings=settings)
            for log, floor_plan, reference in each
        ]
    for replay, log in zip(replays, options.logs, strict=True):
        if not replay.log.referenced.size:
            raise InputError(f"{log} has no reference, so no error is known: give --reference.")
    notes = [] if nav2 is None else nav2.notes
    sideways = [replay.sideways for replay in replays]
    warn([*warnings, *notes, *sideways, *(disagreement(one.scenario) for one in replays)])
    if {replay.log.unit for replay in replays} != {"m"}:
        raise InputError("a log is in px, but tune takes logs in m: give another one.")
    if name != "amcl" and "scan.power" not in replays[0].assumed:
        with doing("fitting the power of the scan model to the first part of the log"):
            replays = [calibrated(replay) for replay in replays]
    return replays


def _each(flag: str, given: list[Any], logs: list[str]) -> list[Any]:
    """Return one for each log."""
    from deqmcl_gym.validation import InputError

    if len(given) == 1:
        return given * len(logs)
    if len(given) != len(logs):
        raise InputError(
            f"{flag} is given {len(given)} times for {len(logs)} logs: give it once, or once for "
            "each log, in their order."
        )
    return given
