"""Logs in plain formats: CSV with a row for each record, and npz.

CSV: a header ``time,odom_x,odom_y,odom_heading,[ref_x,ref_y,ref_heading,]range_0,range_1,…``;
headings in rad; the reference is empty where it is unknown. A first line ``# {JSON}`` has the
scanner: ``angles`` (rad, against the robot's heading), ``max_range`` and, optionally, ``mounting``,
``min_range``; a second line has the unit if it is not m: ``# px``.

npz: ``times`` (n,), ``odometry`` (n, 3), ``ranges`` (n, beams), ``reference`` (n, 3) with NaN where
it is unknown, ``scanner`` with that JSON, ``unit``; no pickles.
"""

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.files import (
    MOST_OF_LOGS,
    UnreadableError,
    numbers_of,
    opened_log,
    save,
    text_of,
)
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.raw_records import UNREADABLE, RawRecords
from deqmcl_gym.validation import InputError

_COLUMNS = ("time", "odom_x", "odom_y", "odom_heading")
_REFERENCE = ("ref_x", "ref_y", "ref_heading")
_ARRAYS = ("times", "odometry", "ranges", "reference", "scanner", "unit")


def read_csv(path: Path, scanner: Scanner | None = None) -> Log:
    """Read a log from CSV.

    Args:
        path: the file, gzipped or not.
        scanner: if the file does not contain it.
    """
    lines = text_of(path).splitlines()
    at_head = itertools.takewhile(lambda line: line.startswith("#"), lines)
    comments = [line[1:].strip() for line in at_head]
    words, unit = (*comments, *(None, None)[len(comments) :])[:2]
    header, *rows = lines[len(comments) :] or [""]
    columns = _cells(header)
    first = _first_range(path, columns)
    at = [columns.index(name) for name in _COLUMNS]
    reference = [columns.index(name) for name in _REFERENCE if name in columns]
    found = RawRecords(str(path))
    for row in map(_cells, filter(str.strip, rows)):
        try:
            if len(row) != len(columns):
                raise ValueError("another number of cells")
            time, *odometry = numbers_of([row[index] for index in at])
            known = [row[index] for index in reference if row[index]]
            truth = numbers_of(known) if len(known) == len(_REFERENCE) else ()
            found.add(time, odometry, numbers_of(row[first:]), reference=truth)
        except ValueError:
            found.damage[UNREADABLE] += 1
    return found.log(lambda beams, *_: _scanner(words, scanner, beams), unit=unit or "m")


def read_npz(path: Path, scanner: Scanner | None = None) -> Log:
    """Read a log from npz; see ``read_csv``."""
    try:
        with opened_log(path) as file, np.load(file, allow_pickle=False) as archive:
            there = archive.files
            wanted = [name for name in _ARRAYS if name in there]
            if sum(archive.zip.getinfo(f"{name}.npy").file_size for name in wanted) > MOST_OF_LOGS:
                raise UnreadableError(
                    f"is larger than {MOST_OF_LOGS:,} bytes, the most that is read"
                )
            known = {name: archive[name] for name in wanted}
    except InputError:
        raise
    except Exception as error:  # damaged bytes can raise anything in zip, zlib and NumPy
        raise InputError(
            f"{path} is not a complete npz file of plain arrays ({error}): write it by "
            "numpy.savez, without pickles."
        ) from None
    missing = [name for name in ("times", "odometry", "ranges") if name not in known]
    if missing:
        raise InputError(f"{path} lacks the array {missing[0]!r}: it has {', '.join(there)}.")
    times, odometry, ranges = (known.pop(name) for name in ("times", "odometry", "ranges"))
    n = times.size
    if (
        any(given.dtype.kind not in "fiu" for given in (times, odometry, ranges))
        or times.shape != (n,)
        or odometry.shape != (n, 3)
        or ranges.ndim != 2
        or len(ranges) != n
    ):
        raise InputError(
            f"{path} has times {times.shape}, odometry {odometry.shape} and ranges {ranges.shape}, "
            "but they must be numbers of shape (n,), (n, 3) and (n, beams)."
        )
    found = RawRecords(str(path), times.tolist(), odometry.tolist(), list(ranges))
    found.fans, found.frames = [None] * n, [""] * n
    if (reference := known.pop("reference", None)) is not None:
        if reference.shape != (n, 3) or reference.dtype.kind not in "fiu":
            raise InputError(f"{path} has a reference {reference.shape}, but it must be {(n, 3)}.")
        whole = np.isfinite(reference).all(axis=1)
        found.references = [
            pose if known else () for pose, known in zip(reference.tolist(), whole, strict=True)
        ]
    else:
        found.references = [()] * n
    words, unit = (str(known[name]) if name in known else None for name in ("scanner", "unit"))
    return found.log(lambda beams, *_: _scanner(words, scanner, beams), unit=unit or "m")


def write_csv(log: Log, path: Path) -> None:
    """Write a log as CSV, all digits."""
    names = [*_COLUMNS, *(_REFERENCE if log.reference is not None else ())]
    names += [f"range_{beam}" for beam in range(log.scanner.beams)]
    lines = [f"# {log.scanner.json}", f"# {log.unit}", ",".join(names)]
    for record in log:
        values: list[object] = [record.time, *record.odometry]
        if log.reference is not None:
            values += record.reference or ("", "", "")
        lines.append(",".join(map(str, [*values, *record.ranges])))
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


def _first_range(path: Path, columns: list[str]) -> int:
    for name in _COLUMNS:
        if name not in columns:
            raise InputError(
                f"{path} lacks the column {name!r}: it has {', '.join(columns)[:200]}."
            )
    if len(set(columns)) < len(columns):
        twice = next(name for name in columns if columns.count(name) > 1)
        raise InputError(f"{path} has the column {twice!r} twice: keep one of them.")
    if 0 < (given := sum(name in columns for name in _REFERENCE)) < len(_REFERENCE):
        raise InputError(
            f"{path} has {given} of the columns {', '.join(_REFERENCE)}: give all of them, or none."
        )
    first = next((i for i, name in enumerate(columns) if name.startswith("range_")), None)
    ranges = columns[first:] if first is not None else []
    if not ranges or ranges != [f"range_{beam}" for beam in range(len(ranges))]:
        raise InputError(f"{path} must end in the columns range_0, range_1, … in this order.")
    return len(columns) - len(ranges)


def _scanner(words: str | None, given: Scanner | None, beams: int) -> Scanner:
    """Return the scanner given, else that of the file."""
    if given is None and words is None:
        raise InputError(
            "it does not contain its scanner: put it in the file, or read it with "
            "scanner=Scanner(angles=…, max_range=…)."
        )
    scanner = given or Scanner.of_json("its scanner", words or "")
    if scanner.beams != beams:
        raise InputError(
            f"it has {beams} ranges a record, but its scanner {scanner.beams} angles: give one for "
            "each."
        )
    return scanner
