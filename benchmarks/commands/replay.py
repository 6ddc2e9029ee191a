"""Play the same records of a log to every localizer, as fast as possible, and compare them.

Writes tables, trajectories (TUM, for evo) and a page: docs/your-map-your-log.md.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import shared
from benchmarks.console import doing

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.robots.nav2 import Amcl

OF_LOGS = "world.…, assumed.… and params.… (docs/your-map-your-log.md)"  # that may be set


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("log", nargs="+", metavar="LOG", help="a CARMEN log or ROS bag, or its parts; CSV or npz")
    add("--map", required=True, metavar="MAP.yaml", help="the map, as for ROS' map_server")
    add("--reference", metavar="REF.tum", help="true poses in the map's frame (the log's own)")
    add("--localizers", default="mcl,amcl", metavar="A,B,…", help="methods (mcl,amcl)")
    add(
        "--start",
        metavar="S",
        help="where the robot starts: reference, global, x,y,θ in m and rad, as in --start=1,2,0, "
        "room=x,y,x,y,…, near=x,y,within[,beyond], or a .toml file (reference, if there is one)",
    )
    add_nav2(
        parser, "Nav2's parameter file: sets all of amcl, and for the others what is not set here"
    )
    add_every(parser, "0.2m,5deg; with amcl 0.0625m,3deg, so that it updates as often as a robot's")
    shared.add_set(parser, "assumed.scan.sigma=0.1 or world.max_beams=60", OF_LOGS)
    add("--seeds", type=int, default=10, metavar="K", help="runs of each localizer (10)")
    shared.add_jobs(parser, "runs")
    shared.add_out(parser, without="results/LOG")
    more = parser.add_argument_group("more")
    more.add_argument("--particles", type=int, metavar="N",
        help="particles of all (each method's default: 1000; amcl: at most 2000)")  # fmt: skip
    more.add_argument(
        "--fit-beams",
        action="store_true",
        help="assume the four-part beam model that fits scans from reference poses in the first "
        "part of the log, and print it",
    )
    more.add_argument(
        "--residuals",
        action="store_true",
        help="also tell and draw where the map is wrong: cells that beams end in or pass though "
        "the map says otherwise",
    )
    shared.add_seed(more)
    shared.add_timeout(more, "run")
    more.add_argument("--dry-run", action="store_true", help="print what would be run, as a sweep "
        "file with all that is set and fitted")  # fmt: skip
    shared.add_mcap(more)


def add_every(parser: shared.TakesOptions, default: str) -> None:
    """Add how far apart the records are that are played."""
    help_ = f"play a record each time the robot has moved this far ({default})"
    parser.add_argument("--every", metavar="D,A", help=help_)


def add_nav2(parser: shared.TakesOptions, words: str) -> None:
    """Add Nav2's parameter file and the node in it."""
    add = parser.add_argument
    add("--nav2", type=Path, metavar="PARAMS.yaml", help=words)
    add("--node", metavar="NAME", help="the node in that file, as in /robot1/amcl (the only amcl)")


def nav2_of(options: argparse.Namespace) -> "Amcl | None":
    """Return what that file says; None: there is none."""
    from benchmarks.robots.nav2 import read_nav2
    from deqmcl_gym.validation import InputError

    if options.node is not None and options.nav2 is None:
        raise InputError("--node is given without --nav2: name the file that the node is in.")
    return None if options.nav2 is None else read_nav2(options.nav2, options.node)


def settings_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return what is set, ``--every`` among it."""
    from benchmarks.setup.documents import settings
    from deqmcl_gym.validation import InputError

    values = settings(options.set)
    if options.every is None:
        return values
    if "world.every" in values:
        raise InputError("--every is given, and world.every set: give one of them.")
    return values | {"world.every": options.every}


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.engines import Where
    from benchmarks.pictures.messages import shown_again
    from benchmarks.robots.replaying import planned, run_replay, sweep_file
    from benchmarks.sweeps.running import Options, complete

    where = Where(jobs=options.jobs, timeout=options.timeout)
    mcap = shared.mcap_of(options)
    plan = planned(
        options.log,
        options.map,
        shared.localizers_named(options.localizers),
        reference=options.reference,
        start=options.start,
        settings=settings_of(options),
        particles=options.particles,
        seeds=options.seeds,
        seed=options.seed,
        nav2=nav2_of(options),
        fit_beams=options.fit_beams,
    )
    if options.dry_run:
        return sweep_file(plan.sweep, [*plan.warnings, *plan.replay.facts]).rstrip()
    out = options.out or Path("results") / Path(options.log[0]).name.partition(".")[0]
    how = Options(where=where)
    played = run_replay(plan, out, how, options.words, residuals=options.residuals)
    text = complete(played.results, str(played))
    if mcap is None:
        return text
    first = list(replace(plan.sweep, trials=1).distinct())
    with doing("playing the first run of each again, to show it"):
        shown_again(first, mcap)
    return f"{text}\n\nMCAP, the first run of each: {options.mcap}"
