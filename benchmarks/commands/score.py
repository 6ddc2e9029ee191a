"""Score what another stack has estimated on a log, with the columns of ``deqmcl replay``.

An estimate is a TUM file, a CSV with time,x,y,heading and perhaps covariances, or a topic of poses
in a bag: docs/tune-on-your-log.md.
"""

import argparse
from typing import Any

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
    shared.add_set(parser, "world.reading.base_frame=base", "world.reading.…")
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
    from benchmarks.robots.played import reading_among
    from benchmarks.robots.scoring import estimates_of, played_before, played_by_replay, score
    from benchmarks.setup.documents import settings
    from deqmcl_gym.logs import read_tum
    from deqmcl_gym.validation import InputError

    beside, log, reference = options.beside, options.log, options.reference
    of_log = {"--map": options.map, "--every": options.every, "--set": options.set or None}
    of_replay = {**of_log, "--log": log, "--reference": reference}
    alone = [name for name, value in of_log.items() if value is not None]
    if beside is not None and (given := [name for name, value in of_replay.items() if value]):
        raise InputError(
            f"{given[0]} is given with --beside, whose folder says what was played: leave one of "
            "them out."
        )
    if beside is None and log is None and alone:
        raise InputError(f"{alone[0]} is given without --log: name the log that it is about.")
    if beside is None and log is None and reference is None:
        raise InputError("there is nothing to score by: give --reference, --log or --beside.")
    with doing("reading the estimates and what they are scored by"), log_warnings() as said:
        by: Any  # a log, or a reference alone
        if beside is not None:
            by = played_before(beside)
        elif log is not None:
            read = reading_among(settings(options.set))
            by = played_by_replay(log, reference, read, options.map, options.every)
        else:
            by = read_tum(reference)
        estimates = estimates_of(options.estimates, options.covariance)
        uncovered, text = score(by, estimates, options.out)
    warn([*said, *uncovered])
    return text
