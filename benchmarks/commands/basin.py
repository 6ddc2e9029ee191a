"""Find how wrong the start may be: localizers with starts that are off by a grid of errors.

Runs segments of a log, or a scenario, and writes the share of runs localized at each error, as a
table and a heat map per localizer: docs/how-wrong-may-the-start-be.md.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import shared
from benchmarks.commands.replay import add_playing
from benchmarks.console import checking, doing, log_warnings, warn

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.replay.options import Replay


_OF_LOG = (
    *("map", "reference", "read", "segment", "every"),
    *("max_beams", "radius", "unknown", "motion", "scan"),
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("log", nargs="?", metavar="LOG", help="a CARMEN log, ROS bag, CSV or npz file")
    add("--map", metavar="MAP.yaml", help="the map of the log, as for ROS' map_server")
    add("--reference", metavar="REF.tum", help="true poses (the log's own, if any)")
    add_playing(parser, "0.2m,5deg; with amcl 0.0625m,3deg")
    add("--segment", type=float, metavar="M", help="metres of a run on a log (20)")
    add("--scenario", metavar="NAME", help="a scenario instead of a log")
    add("--localizers", default="mcl-map,amcl", metavar="A,B,…", help="methods (mcl-map,amcl)")
    shared.add_params(parser)
    add("--particles", type=int, metavar="N", help="particles (each method's default)")
    add("--distances", default="0,0.5,1,2,3,4,5", metavar="D,D,…", help="errors of the position, m "
        "(0,0.5,1,2,3,4,5)")  # fmt: skip
    add("--angles", default="0,30,60,90,135,180", metavar="A,A,…", help="errors of the heading, "
        "degrees (0,30,60,90,135,180)")  # fmt: skip
    add("--spread", default="0.5m,15deg", metavar="D,A", help="standard deviations of the start "
        "(0.5m,15deg, as RViz says them)")  # fmt: skip
    add("--localized", default="1m,30deg", metavar="D,A", help="how near counts (1m,30deg)")
    add("--within", default="10m", metavar="T", help="how soon: a way or steps, as 50steps (10m)")
    shared.add_trials(parser, 10)
    shared.add_seed(parser)
    shared.add_jobs(parser, "runs")
    shared.add_timeout(parser, "run")
    shared.add_out(parser)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.engines import Where
    from benchmarks.replay.basin import Question, basin_sweep, run_basin
    from benchmarks.replay.command import disagreement, gated
    from benchmarks.setup.overrides import NOTHING, Overrides
    from benchmarks.sweeps.running import Options, check
    from deqmcl_gym.validation import InputError, integer, number

    question = Question.told(
        options.distances, options.angles, options.spread, options.localized, options.within
    )
    given = [name for name in _OF_LOG if getattr(options, name) not in (None, [])]
    if (options.log is None) == (options.scenario is None):
        raise InputError("give one of them: a LOG with --map, or --scenario NAME.")
    if options.scenario is not None and given:
        option = given[0].replace("_", "-")
        raise InputError(f"--{option} is of a log, but --scenario is given: leave one out.")
    if options.log is not None and options.map is None:
        raise InputError(f"{options.log} is given without --map: name its map.")
    said: list[str | None] = []
    scenario, world, assumed, title = options.scenario, NOTHING, NOTHING, options.scenario
    if options.log is not None:
        asked = 20.0 if options.segment is None else options.segment
        segment = number("--segment", asked, low=0, above=True)
        if question.unit == "m" and segment <= question.within:
            raise InputError(
                f"--segment is {segment:g} m, but must be longer than --within, "
                f"{question.within:g} m: give a longer segment or a shorter way."
            )
        with doing("reading the log and the map"), log_warnings() as read:
            replay = _replay(options)
        said = [*read, disagreement(replay)]
        whole = {name: own for name, own in replay.world.items() if name not in ("start", "judged")}
        scenario, assumed = "log", replay.assumed
        world = Overrides({**whole, "segment": segment})
        title = f"Segments of {segment:g} m of {Path(options.log).name}"
    localizers = shared.localizers_named(options.localizers)
    with checking():
        sweep = basin_sweep(
            question,
            localizers,
            title=f"How wrong may the start be? {title}",
            scenario=scenario,
            world=world,
            assumed=assumed,
            particles=options.particles,
            own=shared.params_named(options.param, localizers),
            trials=integer("--trials", options.trials, low=1, high=100_000),
            seed=integer("--seed", options.seed),
        )
        check(sweep)
    warn([*said, *gated(sweep, options.every)])
    where = Where(jobs=options.jobs, timeout=options.timeout)
    return run_basin(question, sweep, options.out, Options(where=where), options.words)


def _replay(options: argparse.Namespace) -> "Replay":
    """Return the log as ``deqmcl replay`` reads it, with a power of the scan model."""
    from benchmarks.replay.calibration import calibrated
    from benchmarks.replay.command import every_for
    from benchmarks.replay.options import replay_of, said_of

    told: dict[str, Any] = {"start": "reference", "every": every_for(options.localizers)}
    replay = replay_of(
        options.log, options.map, reference=options.reference, **told | said_of(options)
    )
    return replay if "scan.power" in replay.assumed else calibrated(replay)
