"""Play the same records of a log to every localizer, as fast as possible, and compare them.

Writes tables, trajectories (TUM, for evo) and a page: docs/your-map-your-log.md.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import shared
from benchmarks.console import doing, log_warnings, warn

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.replay.nav2 import Amcl


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("log", nargs="+", metavar="LOG", help="a CARMEN log or ROS bag, or its parts; CSV or npz")
    add("--map", required=True, metavar="MAP.yaml", help="the map, as for ROS' map_server")
    add(
        "--reference",
        metavar="REF.tum",
        help="true poses in the map's frame (the log's own, if any)",
    )
    add(
        "--localizers",
        default="mcl,amcl",
        metavar="A,B,…",
        help="methods, comma-separated (mcl,amcl)",
    )
    shared.add_params(parser)
    add(
        "--start",
        metavar="S",
        help="where the robot starts: reference, global, x,y,θ in m and rad, as in --start=1,2,0, "
        "room=x,y,x,y,…, near=x,y,within[,beyond], or a .toml file (reference, if there is one)",
    )
    add_playing(
        parser, "0.2m,5deg; with amcl 0.0625m,3deg, so that it updates as often as on a robot"
    )
    add(
        "--changed-walls",
        action="append",
        metavar="share=…,seed=…,…",
        help="what if the map were out of date: change this share of its inner walls, which are "
        "removed, added or shifted (distance=0.5, in m; kinds=removed+added+shifted; seed=0)",
    )
    add(
        "--particles",
        type=int,
        metavar="N",
        help="particles (each method's default: 1000; amcl: at most 2000)",
    )
    add("--seeds", type=int, default=10, metavar="K", help="runs of each localizer (10)")
    shared.add_seed(parser)
    add(
        "--fit-beams",
        action="store_true",
        help="assume the four-part beam model that fits scans from reference poses in the first "
        "part of the log, and print it",
    )
    add_nav2(
        parser, "Nav2's parameter file: sets all of amcl, and the options above that are not given"
    )
    add(
        "--residuals",
        action="store_true",
        help="also tell and draw where the map is wrong: cells that beams end in or pass though "
        "the map says otherwise",
    )
    shared.add_mcap(parser)
    shared.add_jobs(parser, "runs")
    shared.add_timeout(parser, "run")
    shared.add_out(parser)


def add_playing(
    parser: argparse.ArgumentParser, every: str = "0.2m,5deg", beams: str = "60"
) -> None:
    """Add how a log is read and played, and what localizers assume; ``said_of`` takes them."""
    add = parser.add_argument
    shared.add_read(parser)
    add(
        "--every",
        metavar="D,A",
        help=f"play a record each time the robot has moved this far ({every})",
    )
    add("--max-beams", type=int, metavar="B", help=f"beams used of a scan, evenly spread ({beams})")
    add("--radius", type=float, metavar="R", help="radius of the robot in m (0.16)")
    add(
        "--unknown",
        choices=("obstacle", "transparent", "free"),
        help="what unknown cells of the map are: in the way of beams and of the robot, of the "
        "robot alone, or of neither (obstacle)",
    )
    add(
        "--motion",
        action="append",
        metavar="alpha1=…,alpha2=…,…",
        help="motion noise, Nav2's alphas; kind=omni or kind=odometry selects another model "
        "(kind=differential; estimated from the reference, at least half of Nav2's defaults)",
    )
    add(
        "--scan",
        action="append",
        metavar="sigma=…,power=…,…",
        help="parameters of the beam model; kind=NAME selects another model (sigma=0.2, in m; "
        "power is fitted to the first part of the log)",
    )


def add_nav2(parser: argparse.ArgumentParser, words: str) -> None:
    """Add Nav2's parameter file and the node in it."""
    add = parser.add_argument
    add("--nav2", type=Path, metavar="PARAMS.yaml", help=words)
    add("--node", metavar="NAME", help="the node in that file, as in /robot1/amcl (the only amcl)")


def nav2_of(options: argparse.Namespace) -> "Amcl | None":
    """Return what that file says; None: there is none."""
    from benchmarks.replay.nav2 import read_nav2
    from deqmcl_gym.validation import InputError

    if options.node is not None and options.nav2 is None:
        raise InputError("--node is given without --nav2: name the file that the node is in.")
    return None if options.nav2 is None else read_nav2(options.nav2, options.node)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.engines import Where
    from benchmarks.pictures.messages import shown_again
    from benchmarks.replay.calibration import calibrated, judged_alike, uses_scan, with_fitted_beams
    from benchmarks.replay.command import every_for, gated, replay_sweep, run_replay
    from benchmarks.replay.options import replay_of, said_of
    from benchmarks.sweeps.running import Options, check

    where = Where(jobs=options.jobs, timeout=options.timeout)
    mcap = shared.mcap_of(options)
    nav2 = nav2_of(options)
    told: dict[str, Any] = {"every": every_for(options.localizers)}
    if nav2 is not None:
        told = nav2.options if not options.fit_beams else {**nav2.options, "scan": {}}
    given = said_of(options)
    for name in ("scan", "reading"):  # of these, single values are given
        given[name] = {**told.get(name, {}), **given.get(name, {})}
    with doing("reading the log and the map"), log_warnings() as said:
        replay = replay_of(options.log, options.map, reference=options.reference, **told | given)
    notes = warn(said)  # whatever fails later
    if options.fit_beams:
        with doing("fitting the beam model to the first part of the log"):
            replay = with_fitted_beams(replay)
    localizers = shared.localizers_named(options.localizers)
    own = shared.params_named(options.param, localizers)
    if "scan.power" not in replay.assumed:
        if any(uses_scan(name, own.get(name, {})) for name in localizers):
            with doing("fitting the power of the scan model to the first part of the log"):
                replay = calibrated(replay)
        else:
            replay = judged_alike(replay)
    sweep = replay_sweep(
        replay,
        localizers,
        particles=options.particles,
        seeds=options.seeds,
        root=options.seed,
        shared={} if nav2 is None else {"amcl": nav2.params},
        own=own,
    )
    check(sweep)
    notes += warn(gated(sweep, options.every))
    if nav2 is not None:
        amcl = next((one.params for one in sweep.localizers if one.name == "amcl"), None)
        notes += warn([*nav2.notes, *([] if amcl is None else nav2.differences(amcl, replay))])
    how = Options(where=where)
    text = run_replay(
        replay, sweep, options.out, how, options.words, notes, residuals=options.residuals
    )
    if mcap is None:
        return text
    first = list(replace(sweep, trials=1).distinct())
    with doing("playing the first run of each again, to show it"):
        shown_again(first, mcap)
    return f"{text}\n\nMCAP, the first run of each: {options.mcap}"
