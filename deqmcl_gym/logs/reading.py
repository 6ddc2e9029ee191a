"""Reading and writing of logs; the ending of the name determines the format."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any

from deqmcl_gym.logs import carmen, csv_npz, ros
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.trajectory import Trajectory, referenced
from deqmcl_gym.validation import InputError, array, number, shown

_TEXT = (".log", ".clf", ".carmen", ".txt")
_READERS: Mapping[str, Callable[..., Log]] = MappingProxyType(
    dict.fromkeys(_TEXT, carmen.read_carmen)
    | {".csv": csv_npz.read_csv, ".npz": csv_npz.read_npz}
    | dict.fromkeys(("", ".bag", ".mcap", ".db3"), ros.read_bag)
)
_WRITERS: Mapping[str, Callable[[Log, Path], None]] = MappingProxyType(
    {".csv": csv_npz.write_csv, ".npz": csv_npz.write_npz}
)
_OF_REFERENCE = "max_gap", "reference_tolerance"
_TAKEN: Mapping[Any, tuple[str, ...]] = MappingProxyType(
    {
        carmen.read_carmen: ("scan_topic", "field_of_view", *_OF_REFERENCE),
        ros.read_bag: (
            "scan_topic", "odometry_topic", "odometry_frame", "odometry_publisher",
            "reference_topic", "base_frame", "max_range", "max_apart", *_OF_REFERENCE,
        ),
        csv_npz.read_csv: ("scanner",),
        csv_npz.read_npz: ("scanner",),
    }
)  # fmt: skip


def read(
    path: str | PathLike[str] | Sequence[str | PathLike[str]],
    *,
    reference: str | PathLike[str] | Trajectory | None = None,
    max_gap: float | None = None,
    reference_tolerance: float | None = None,
    max_range: float | None = None,
    min_range: float | None = None,
    mounting: tuple[float, float, float] | None = None,
    scanner: Scanner | None = None,
    scan_topic: str | Sequence[str] | None = None,
    max_apart: float | None = None,
    odometry_topic: str | None = None,
    odometry_frame: str | None = None,
    odometry_publisher: int | None = None,
    reference_topic: str | None = None,
    base_frame: str | None = None,
    field_of_view: float | None = None,
) -> Log:
    """Read a log; the ending of its name determines the format.

    ``.log``, ``.clf``, ``.carmen``, ``.txt``, also with ``.gz``: CARMEN. ``.csv`` (``.csv.gz``),
    ``.npz``: see ``logs.csv_npz``. ``.bag``: ROS 1. ``.mcap``, ``.db3`` or a folder: ROS 2. Bags
    need ``pip install "deqmcl-gym[ros]"``. Damaged records are skipped; a ``LogWarning`` counts
    them.

    Args:
        path: the file, or the folder of a ROS 2 bag; of a bag or a CARMEN log also several, its
            parts.
        reference: a TUM file or a trajectory, in the map's frame and with the log's clock.
        max_gap, reference_tolerance: of the reference, or of that in a CARMEN log or a bag: see
            ``referenced``.
        max_range, min_range: ranges at them or beyond count as no measurement, like those at or
            beyond the scanner's own. A bag whose scans have a range_max of inf or 0 needs
            ``max_range``.
        mounting: of the scanner on the robot, x ahead, y left, turn in rad; replaces the log's. The
            default of a log without one is the robot's centre.
        scanner: for CSV and npz files that do not contain it.
        scan_topic: of a ROS bag; "FLASER", "ROBOTLASER1" or "RAWLASER1" of a CARMEN log. None takes
            the only one, as do the next. Several topics of a bag make one scan of several lidars: a
            record has one of each, moved by the odometry to the stamp of the rarest; see
            ``logs.pairing``.
        max_apart: of the stamps of such scans, s; None is 0.1.
        odometry_topic: of a ROS bag; None also takes moving transforms: from ``odom``, or the only
            ones above the scanner.
        odometry_frame: of a ROS bag, from which transforms move the robot, instead of a topic.
        odometry_publisher: 1, 2, …: which one, if several send odometry on one topic.
        reference_topic: of a ROS bag, with poses of the robot in the map; None takes ``/reference``
            if it exists.
        base_frame: the robot's frame in a ROS bag; None is the odometry's.
        field_of_view: of the scanner of a CARMEN log's FLASER lines, rad; None: as PARAM lines say,
            or π, as of a SICK LMS.

    Raises:
        InputError: the format is unknown or does not take an argument, the file is missing or
            damaged as a whole, or no record is usable.
    """
    paths: Sequence[Any] = path if isinstance(path, list | tuple) and path else [path]
    if not all(isinstance(one, str | PathLike) for one in paths):
        raise InputError(f"the log is {shown(path)}, but must be the path of a file, or several.")
    files = [Path(one) for one in paths]
    reader = _reader_of(files)
    options: dict[str, Any] = {
        "scanner": scanner, "scan_topic": scan_topic, "max_apart": max_apart,
        "odometry_topic": odometry_topic, "odometry_frame": odometry_frame,
        "odometry_publisher": odometry_publisher, "reference_topic": reference_topic,
        "base_frame": base_frame, "field_of_view": field_of_view,
    }  # fmt: skip
    given = {name: value for name, value in options.items() if value is not None}
    if max_gap is not None:
        number("max_gap", max_gap, low=0, finite=False)
    of_reference = {"max_gap": max_gap, "reference_tolerance": reference_tolerance}
    if reference is None:
        given |= {name: value for name, value in of_reference.items() if value is not None}
    if reader is ros.read_bag:
        given["max_range"] = max_range
    for name in given:
        if name not in _TAKEN[reader]:
            raise InputError(
                f"{name} is given, but {files[0]} is of a format that does not take it."
            )
    parts = files if "scan_topic" in _TAKEN[reader] else files[0]
    log = _changed(reader(parts, **given), max_range, min_range, mounting)
    return log if reference is None else referenced(log, reference, max_gap, reference_tolerance)


def _reader_of(files: Sequence[Path]) -> Callable[..., Log]:
    """Return what reads all of some files."""
    readers = []
    for file in files:
        reader = _READERS.get(_ending(file))
        if reader is None or (_ending(file) == "" and os.path.isfile(file)):
            raise InputError(
                f"{file} is of an unknown format: the name of a log ends in {', '.join(_TEXT)} "
                "(CARMEN; .gz may follow), .csv, .npz, .bag, .mcap or .db3, or is the folder of a "
                "ROS 2 bag."
            )
        readers.append(reader)
    if len(files) > 1 and (len(set(readers)) > 1 or "scan_topic" not in _TAKEN[readers[0]]):
        raise InputError(
            f"{', '.join(map(str, files))} are {len(files)} files, but only bags and CARMEN logs "
            "have several parts, all of one kind: give one log."
        )
    return readers[0]


def write(log: Log, path: str | PathLike[str]) -> None:
    """Write a log, whole or not at all; the ending of the name determines the format.

    ``.csv``, ``.csv.gz``, ``.npz``: see ``logs.csv_npz``.

    Raises:
        InputError: the format is another, or the file cannot be written.
    """
    _WRITERS[check_writable(path)](log, Path(path))


def check_writable(path: str | PathLike[str]) -> str:
    """Return the ending of a log's name, which determines its format.

    Raises:
        InputError: the format is read only, or unknown.
    """
    ending = _ending(Path(path))
    if ending not in _WRITERS:
        raise InputError(
            f"{path} is of a format that is not written: end the name in .csv, .csv.gz or .npz."
        )
    return ending


def _ending(path: Path) -> str:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes[-1:] == [".gz"] and suffixes[-2:-1] and suffixes[-2] in (*_TEXT, ".csv"):
        suffixes.pop()
    if os.path.isdir(path):  # False for a name that is too long
        return ""
    return suffixes[-1] if suffixes else ""


def _changed(
    log: Log,
    max_range: float | None,
    min_range: float | None,
    mounting: tuple[float, float, float] | None,
) -> Log:
    scanner = log.scanner
    if max_range is not None:
        seen = number("max_range", max_range, low=0, above=True)
        scanner = replace(scanner, max_range=min(seen, scanner.max_range))
    if min_range is not None:
        near = number("min_range", min_range, low=0)
        scanner = replace(scanner, min_range=max(near, scanner.min_range))
    if mounting is not None:
        if scanner.mounts:
            raise InputError(
                f"mounting is given, but the scanner of {log.source} has mounts of its own: leave "
                "it out, or change them in the log."
            )
        x, y, turn = array("mounting", mounting, (3,)).tolist()
        angles = tuple((scanner.bearings - scanner.turn + turn).tolist())
        scanner = replace(scanner, angles=angles, mounting=(x, y), turn=turn)
    return log if scanner is log.scanner else replace(log, scanner=scanner)
