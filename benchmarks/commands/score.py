"""Score what another stack has estimated on a log, with the columns of ``deqmcl replay``.

An estimate is a TUM file, a CSV with time,x,y,heading and perhaps covariances, or a topic of poses
in a bag: docs/score-your-stack.md.
"""

import argparse

from benchmarks.commands import shared
from benchmarks.console import doing, log_warnings, warn


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add(
        "estimates",
        nargs="+",
        metavar="THEIRS",
        help="an estimate, [NAME=]FILE[:TOPIC]: slam.tum, mine=poses.csv, run.mcap:/amcl_pose",
    )
    add("--reference", metavar="REF.tum", help="true poses in the map's frame")
    add(
        "--beside",
        type=shared.folder,
        metavar="DIR",
        help="a folder of deqmcl replay: its log, reference and map, and its rows in the table",
    )
    add("--log", metavar="LOG", help="score at the records of a log, as replay does")
    add("--map", metavar="MAP.yaml", help="compare the log's scans with a map")
    shared.add_set(parser, "world.reading.base_frame=base")
    add("--every", metavar="D,A", help="score a record each time the robot has moved this far "
        "(0.2m,5deg)")  # fmt: skip
    add(
        "--covariance",
        metavar="FILE",
        help="covariances of the only estimate, lines of a time and 6, 9 or 36 numbers",
    )
    shared.add_out(parser)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.replay.options import reading_among
    from benchmarks.replay.theirs import Yardstick, estimates_of, score
    from benchmarks.sweeps.settings import settings
    from deqmcl_gym.logs import read_tum
    from deqmcl_gym.validation import InputError

    of_log = {"--map": options.map, "--every": options.every, "--set": options.set or None}
    given = [name for name, value in of_log.items() if value is not None]
    if options.beside is not None:
        given += [f"--{name}" for name in ("log", "reference") if getattr(options, name)]
        if given:
            raise InputError(
                f"{given[0]} is given with --beside, whose folder says what was played: leave one "
                "of them out."
            )
    elif options.log is None and given:
        raise InputError(f"{given[0]} is given without --log: name the log that it is about.")
    elif options.log is None and options.reference is None:
        raise InputError("there is nothing to score by: give --reference, --log or --beside.")
    with doing("reading the estimates and what they are scored by"), log_warnings() as said:
        if options.beside is not None:
            yardstick = Yardstick.of_replay(options.beside)
        elif options.log is not None:
            yardstick = Yardstick.of_log(
                options.log,
                options.reference,
                reading_among(settings(options.set)),
                options.map,
                options.every,
            )
        else:
            yardstick = Yardstick(reference=read_tum(options.reference))
        uncovered, text = score(
            yardstick, estimates_of(options.estimates, options.covariance), options.out
        )
    warn([*said, *uncovered])
    return text
