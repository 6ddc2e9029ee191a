"""The arguments of ``LogEnv``: log, map, plan, and the segments that its episodes play."""

import math
import re
from collections.abc import Mapping
from inspect import signature
from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym import logs
from deqmcl_gym.logs.motion import increments_of
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.validation import InputError, array, number, one_of, shown
from deqmcl_gym.world.presets import WORLDS

PLANS = ("odometry", "reference", "none")


def log_of(given: Any, reference: Any, reading: Mapping[str, Any] | None) -> logs.Log:
    """Return a log given as a ``Log`` or by its path, with its reference.

    Raises:
        InputError: it is neither, or cannot be read.
    """
    if not isinstance(given, logs.Log):
        if not isinstance(given, str | PathLike):
            raise InputError(f"log is {given!r}, but must be the path of a log, or a Log.")
        if not isinstance(reading, Mapping | None):
            raise InputError(f"reading is {shown(reading)}, but must be arguments of logs.read.")
        options = dict(reading or {})
        allowed = set(signature(logs.read).parameters) - {"path", "reference"}
        for name in options:
            one_of("key in reading", name, allowed)
        return logs.read(given, reference=reference, **options)
    if reading:
        raise InputError("reading is given, but the log has been read already: leave it out.")
    return given if reference is None else logs.referenced(given, reference)


def map_of(given: Any, unknown: Any, log: logs.Log) -> Map | None:
    """Return a map given as a ``Map``, by its path or by its corners; None is none.

    Raises:
        InputError: it is none of these, or not in the log's unit; or it is told what unknown cells
            count as, but is not the path of a yaml.
    """
    if unknown is not None:
        if not (isinstance(given, str | PathLike) and str(given).endswith((".yaml", ".yml"))):
            raise InputError(
                f"unknown is {shown(unknown)} and map is {shown(given)}, but unknown cells are "
                "only those of a map's yaml: give its path as map, or leave unknown out."
            )
        given = {"file": given, "unknown": unknown}
    if given is None:
        return None
    found = (
        given if isinstance(given, Map) else WORLDS["paper"].changed(floor_plan=given).floor_plan
    )
    if found.unit != log.unit:
        raise InputError(
            f"the map is in {found.unit}, but {log.source} in {log.unit}: give a map in {log.unit}."
        )
    return found


def planned_of(plan: str, log: logs.Log, segments: Indices) -> Floats:
    """Return the planned increments of a log's steps, (n - 1, 3); (0, 3) for "none".

    Args:
        plan: one of ``PLANS``.
        log: the records.
        segments: see ``segments_of``.

    Raises:
        InputError: it is "reference", but a record of a segment has no reference pose.
    """
    if one_of("plan", plan, PLANS) == "none":
        return np.empty((0, 3))
    if plan == "odometry":
        return log.increments
    unknown = _unknown(log)
    if log.reference is None or (unknown[segments[:, 1] + 1] > unknown[segments[:, 0]]).any():
        raise InputError(
            f'plan is "reference", but {unknown[-1]:,} of {len(log):,} records of '
            f"{log.source} have no reference pose: choose a segment where all do by start and "
            'length, or plan="odometry".'
        )
    return increments_of(log.reference)


def segments_of(log: logs.Log, length: float | None) -> Indices:
    """Return the first and the last record of each segment that an episode may play, (k, 2).

    Args:
        log: the records; where it has a reference, each record of a segment must have one.
        length: of a segment, by odometry; None is the whole log.

    Raises:
        InputError: no segment has this length.
    """
    if length is None:
        return np.array([[0, len(log) - 1]])
    number("segment", length, low=0, above=True)
    way = log.driven
    last = np.searchsorted(way, way + length)
    whole = last < len(log)
    if log.reference is not None:
        unknown = _unknown(log)
        whole[whole] = unknown[last[whole] + 1] == unknown[:-1][whole]
    if not whole.any():
        where = "" if log.reference is None else " with a reference at each record"
        raise InputError(
            f"segment is {length:g} {log.unit}, but {log.source}, of {way[-1]:.4g} {log.unit}, has "
            f"no stretch as long as that{where}: give a smaller segment."
        )
    return np.column_stack([np.flatnonzero(whole), last[whole]])


def _unknown(log: logs.Log) -> Indices:
    """Number of records without a reference among the first k, k = 0 … n, (n + 1,)."""
    unknown = np.ones(len(log), np.intp)
    unknown[log.referenced] = 0
    return np.concatenate([[0], np.cumsum(unknown)])


def spacing(what: str, given: object, unit: str) -> tuple[float, float]:
    """Return a distance and an angle (rad) of "0.2m,5deg", "0.2m", "5deg", "0.1rad" or a pair.

    Raises:
        InputError: it is none of these, or not in the log's unit.
    """
    if not isinstance(given, str):
        distance, angle = array(what, cast(ArrayLike, given), (2,)).tolist()
        return distance, angle
    found = {"length": math.inf, "angle": math.inf}
    for part in given.split(","):
        match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(m|px|deg|°|rad)\s*", part)
        kind = "length" if match and match[2] in ("m", "px") else "angle"
        if match is None or math.isfinite(found[kind]):
            raise InputError(
                f'{what} is {given!r}, but must be a distance and an angle, such as "0.2m,5deg".'
            )
        if kind == "length" and match[2] != unit:
            raise InputError(f"{what} is {given!r}, but the log is in {unit}: give {unit}.")
        value = float(match[1])
        found[kind] = math.radians(value) if match[2] in ("deg", "°") else value
    return found["length"], found["angle"]
