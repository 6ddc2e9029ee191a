"""``deqmcl replay``."""

import argparse
import warnings
from collections.abc import Sequence

from benchmarks.commands.shared import folder, localizers_named
from benchmarks.console import doing

NAME = "replay"
HELP = "play a recorded log to localizers, and compare them"
DESCRIPTION = (
    "Play the same records of a log to every localizer, as fast as possible, and write tables, "
    "trajectories (TUM, for evo) and a page: docs/your-map-your-log.md."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("log", metavar="LOG", help="a CARMEN log, ROS bag, CSV or npz file")
    add("--map", required=True, metavar="MAP.yaml", help="the map, as of ROS' map_server")
    add("--reference", metavar="REF.tum", help="true poses in the map's frame (the log's own)")
    add(
        "--localizers",
        default="mcl,amcl",
        metavar="A,B,…",
        help="methods, comma-separated (mcl,amcl)",
    )
    add(
        "--start",
        metavar="S",
        help="reference, global or --start=x,y,θ in m and rad (the reference, if there is one)",
    )
    add(
        "--every",
        default="0.2m,5deg",
        metavar="D,A",
        help="play a record whenever the robot has moved so far (0.2m,5deg)",
    )
    add("--max-beams", type=int, default=60, metavar="B", help="beams used, evenly spread (60)")
    add("--particles", type=int, default=1000, metavar="N", help="particles (1000)")
    add("--seeds", type=int, default=10, metavar="K", help="runs of each localizer (10)")
    add("--seed", type=int, default=0, help="root of all randomness (0)")
    add(
        "--motion",
        metavar="drive=…,turn=…,drift=…",
        help="noise of the motion (estimated from the reference; without one 0.2 each)",
    )
    add(
        "--scan",
        metavar="sigma=…,power=…,…",
        help="what a beam model assumes; kind=NAME chooses another (sigma=0.2, in m)",
    )
    add("--jobs", type=int, metavar="J", help="runs at a time (one per processor)")
    add(
        "--timeout",
        type=float,
        metavar="S",
        help="seconds that a run may take (no limit; a plug-in's 3600, and 60 to be made)",
    )
    add("--out", type=folder, required=True, metavar="DIR", help="output folder")


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.apart import answered_within
    from benchmarks.execution.engines import Where
    from benchmarks.replay.command import run_replay
    from benchmarks.replay.running import runs_of
    from benchmarks.replay.setting import setting_of
    from deqmcl_gym import logs

    where = Where(jobs=options.jobs, timeout=options.timeout)
    with doing("reading the log and the map"), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", logs.LogWarning)
        log = logs.read(options.log, reference=options.reference)
        setting = setting_of(
            log,
            options.map,
            start=options.start,
            every=options.every,
            max_beams=options.max_beams,
            motion=options.motion,
            scan=options.scan,
        )
    said = [str(one.message) for one in caught if issubclass(one.category, logs.LogWarning)]
    with answered_within(options.timeout):
        runs = runs_of(
            setting,
            localizers_named(options.localizers),
            particles=options.particles,
            seeds=options.seeds,
            root=options.seed,
        )
    return run_replay(setting, runs, options.out, where, ["deqmcl", *given], said)
