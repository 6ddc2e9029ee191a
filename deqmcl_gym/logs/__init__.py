"""Logs: recordings of robots, read from several formats into one form; written as CSV and npz.

>>> from deqmcl_gym import logs
>>> log = logs.read("robot.log.gz", reference="robot.tum")

The ending of a name determines the format.

CSV: a header ``time,odom_x,odom_y,odom_heading,[ref_x,ref_y,ref_heading,]range_0,range_1,…``;
headings in rad; the reference is empty where it is unknown. A first line ``# {JSON}`` has the
scanner: ``angles`` (rad, against the robot's heading), ``max_range`` and, optionally, ``mounting``,
``min_range``; a second line has the unit if it is not m: ``# px``.

npz: ``times`` (n,), ``odometry`` (n, 3), ``ranges`` (n, beams), ``reference`` (n, 3) with NaN where
it is unknown, ``scanner`` with that JSON, ``unit``; no pickles.
"""

import io
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from inspect import signature
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.files import MOST_OF_LOGS, columns_of, numbers_of, opened, refusing, save, text_of
from deqmcl_gym.logs import carmen, ros
from deqmcl_gym.logs.log import Log, Record, Scanner
from deqmcl_gym.logs.raw_records import UNREADABLE, RawRecord, RawRecords
from deqmcl_gym.logs.trajectory import Trajectory, read_tum, referenced
from deqmcl_gym.validation import InputError, LogWarning, array, number, shown

__all__ = [
    "Log", "LogWarning", "Record", "Scanner", "Trajectory", "check_writable", "read", "read_tum",
    "referenced", "write",
]  # fmt: skip

_COLUMNS = ("time", "odom_x", "odom_y", "odom_heading")
_REFERENCE = ("ref_x", "ref_y", "ref_heading")
_ARRAYS = ("times", "odometry", "ranges", "reference", "scanner", "unit")


def read_csv(path: Path, scanner: Scanner | None = None) -> Log:
    """Read a log from CSV, gzipped or not; the scanner is needed if the file has none."""
    lines = text_of(path).splitlines()
    comments = [*itertools.takewhile(lambda line: line.startswith("#"), lines)]
    text, unit, *_ = [*(line[1:].strip() for line in comments), None, None]
    header, *rows = lines[len(comments) :] or [""]
    columns = _cells(header)
    at = columns_of(path, columns, _COLUMNS, _REFERENCE)
    beams = sum(name.startswith("range_") for name in columns)
    first = len(columns) - beams
    if beams == 0 or columns[first:] != [f"range_{beam}" for beam in range(beams)]:
        raise InputError(f"{path} must end in the columns range_0, range_1, … in this order.")
    raw = RawRecords(str(path))
    for row in map(_cells, filter(str.strip, rows)):
        try:
            if len(row) != len(columns):
                raise ValueError("another number of cells")
            time, *odometry = numbers_of([row[index] for index in at[: len(_COLUMNS)]])
            cells = [row[index] for index in at[len(_COLUMNS) :] if row[index]]
            truth = numbers_of(cells) if len(cells) == len(_REFERENCE) else ()
            ranges = numbers_of(row[first:])
            raw.records.append(RawRecord(time, odometry, ranges, reference=truth))
        except ValueError:
            raw.damage[UNREADABLE] += 1
    return _log_of(raw, text, unit, scanner)


def read_npz(path: Path, scanner: Scanner | None = None) -> Log:
    """Read a log from npz; see ``read_csv``."""
    try:
        with refusing(path), opened(path) as file, np.load(file, allow_pickle=False) as archive:
            names = archive.files
            wanted = [name for name in _ARRAYS if name in names]
            if sum(archive.zip.getinfo(f"{name}.npy").file_size for name in wanted) > MOST_OF_LOGS:
                raise InputError(
                    f"{path} is larger than {MOST_OF_LOGS:,} bytes, the most that is read: give "
                    "another file."
                )
            data = {name: archive[name] for name in wanted}
    except InputError:
        raise
    except Exception as error:  # damaged bytes can raise anything in zip, zlib and NumPy
        raise InputError(
            f"{path} is not a complete npz file of plain arrays ({error}): write it by "
            "numpy.savez, without pickles."
        ) from None
    missing = [name for name in ("times", "odometry", "ranges") if name not in data]
    if missing:
        raise InputError(f"{path} lacks the array {missing[0]!r}: it has {', '.join(names)}.")
    n, beams = data["times"].size, data["ranges"].shape[1:2]
    data = {"reference": np.full((n, 3), np.nan)} | data
    for name, shape in {
        "times": (n,), "odometry": (n, 3), "ranges": (n, *beams), "reference": (n, 3),
    }.items():  # fmt: skip
        if data[name].shape != shape or data[name].dtype.kind not in "fiu" or not beams:
            raise InputError(
                f"{path} has {name} of shape {data[name].shape} and type {data[name].dtype}, but "
                "times must be numbers of shape (n,), odometry (n, 3), ranges (n, beams), and a "
                "reference (n, 3)."
            )
    truth = [pose if np.isfinite(pose).all() else () for pose in data["reference"].tolist()]
    columns = data["times"].tolist(), data["odometry"].tolist(), data["ranges"], truth
    rows = zip(*columns, strict=True)
    records = [RawRecord(time, at, scan, reference=pose) for time, at, scan, pose in rows]
    text, unit = (str(data[name]) if name in data else None for name in ("scanner", "unit"))
    return _log_of(RawRecords(str(path), records), text, unit, scanner)


def write_csv(log: Log, path: Path) -> None:
    """Write a log as CSV, all digits."""
    columns = () if log.reference is None else _REFERENCE
    names = [*_COLUMNS, *columns, *(f"range_{beam}" for beam in range(log.scanner.beams))]
    lines = [f"# {log.scanner.json}", f"# {log.unit}", ",".join(names)]
    for record in log:
        pose = (record.reference or ("", "", "")) if columns else ()
        lines.append(",".join(map(str, [record.time, *record.odometry, *pose, *record.ranges])))
    save(path, ("\n".join(lines) + "\n").encode())


def write_npz(log: Log, path: Path) -> None:
    """Write a log as npz, compressed."""
    arrays: dict[str, Any] = {"times": log.times, "odometry": log.odometry, "ranges": log.ranges}
    if log.reference is not None:
        arrays["reference"] = log.reference
    arrays |= {"scanner": np.array(log.scanner.json), "unit": np.array(log.unit)}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    save(path, buffer.getvalue())


def _cells(line: str) -> list[str]:
    """Split a line at its commas, also within quotes: a stray quote affects its line only."""
    return [cell.strip().strip('"') for cell in line.split(",")]


def _log_of(records: RawRecords, text: str | None, unit: str | None, given: Scanner | None) -> Log:
    """Return records as a log of the scanner given, else of that of the file."""

    def scanner_of(beams: int, *_: Any) -> Scanner:
        if given is None and text is None:
            raise InputError(
                "it does not contain its scanner: put it in the file, or read it with "
                "scanner=Scanner(angles=…, max_range=…)."
            )
        scanner = given or Scanner.of_json("its scanner", text or "")
        if scanner.beams != beams:
            raise InputError(
                f"it has {beams} ranges a record, but its scanner {scanner.beams} angles: give one "
                "for each."
            )
        return scanner

    return records.log(scanner_of, unit=unit or "m")


_TEXT = (".log", ".clf", ".carmen", ".txt")
_READERS: Mapping[str, Callable[..., Log]] = {
    ".csv": read_csv, ".npz": read_npz, **dict.fromkeys(_TEXT, carmen.read_carmen),
    **dict.fromkeys(("", ".bag", ".mcap", ".db3"), ros.read_bag),
}  # fmt: skip
_WRITERS = {".csv": write_csv, ".npz": write_npz}


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
    ``.npz``: see ``deqmcl_gym.logs``. ``.bag``: ROS 1. ``.mcap``, ``.db3`` or a folder: ROS 2. Bags
    need ``pip install "deqmcl-gym[ros]"``. Damaged records are skipped; a ``LogWarning`` counts
    them.

    Args:
        path: the file, or the folder of a ROS 2 bag; of a bag also several, its parts.
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
            ``paired_scans``.
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
    """
    # all arguments that were given; first of all, as there is no other local name yet
    asked = {name: value for name, value in locals().items() if value is not None}
    paths: Sequence[Any] = path if isinstance(path, list | tuple) and path else [path]
    if not all(isinstance(part, str | PathLike) for part in paths):
        raise InputError(f"the log is {shown(path)}, but must be the path of a file, or several.")
    files = [Path(part) for part in paths]
    reader = _reader_of(files)
    if max_gap is not None:
        number("max_gap", max_gap, low=0, finite=False)
    taken, own = signature(reader).parameters, {"path", "reference", "min_range", "mounting"}
    if reference is not None:
        own |= {"max_gap", "reference_tolerance"}
    if "max_range" not in taken:
        own.add("max_range")
    arguments = {name: value for name, value in asked.items() if name not in own}
    for name in arguments:
        if name not in taken:
            raise InputError(
                f"{name} is given, but {files[0]} is of a format that does not take it."
            )
    log = reader(files if "paths" in taken else files[0], **arguments)
    scanner = _changed(log, max_range, min_range, mounting)
    log = log if scanner is log.scanner else replace(log, scanner=scanner)
    return log if reference is None else referenced(log, reference, max_gap, reference_tolerance)


def _reader_of(files: Sequence[Path]) -> Callable[..., Log]:
    """Return what reads all of some files."""
    readers = [_READERS.get(_ending(file)) for file in files]
    for file, reader in zip(files, readers, strict=True):
        if reader is None or (_ending(file) == "" and os.path.isfile(file)):
            raise InputError(
                f"{file} is of an unknown format: the name of a log ends in {', '.join(_TEXT)} "
                "(CARMEN; .gz may follow), .csv, .npz, .bag, .mcap or .db3, or is the folder of a "
                "ROS 2 bag."
            )
    if len(files) > 1 and {*readers} != {ros.read_bag}:
        raise InputError(
            f"{', '.join(map(str, files))} are {len(files)} files, but only bags have several "
            "parts, all of one kind: give one log."
        )
    return _READERS[_ending(files[0])]


def write(log: Log, path: str | PathLike[str]) -> None:
    """Write a log, whole or not at all, as CSV or npz by the ending of the name."""
    _WRITERS[check_writable(path)](log, Path(path))


def check_writable(path: str | PathLike[str]) -> str:
    """Return the ending of a log's name, its format; refuse one that is read only."""
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


def _changed(log: Log, max_range: float | None, min_range: float | None, mounting: Any) -> Scanner:
    """Return the scanner of a log with what is given."""
    scanner = log.scanner
    if max_range is not None:
        seen = number("max_range", max_range, low=0, above=True)
        scanner = replace(scanner, max_range=min(seen, scanner.max_range))
    if min_range is not None:
        near = number("min_range", min_range, low=0)
        scanner = replace(scanner, min_range=max(near, scanner.min_range))
    if mounting is None:
        return scanner
    if scanner.mounts:
        raise InputError(
            f"mounting is given, but the scanner of {log.source} has mounts of its own: leave it "
            "out, or change them in the log."
        )
    x, y, turn = array("mounting", mounting, (3,)).tolist()
    angles = tuple((scanner.bearings - scanner.turn + turn).tolist())
    return replace(scanner, angles=angles, mounting=(x, y), turn=turn)
