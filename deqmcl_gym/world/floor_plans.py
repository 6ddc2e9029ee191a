"""A floor plan as it is given: a map, its file, or a mapping of what it is made of."""

import os
from collections.abc import Mapping
from typing import Any

from deqmcl_gym.maps import GridMap, Map, Office, PolygonMap, polygon_file
from deqmcl_gym.validation import InputError, one_of, part, shown


def floor_plan_of(given: Any) -> Map:
    """Return the map that is given; see ``World.changed`` for how it may be.

    Raises:
        InputError: it is given in no such way, or its file cannot be read.
    """
    if isinstance(given, PolygonMap | GridMap):
        return given
    if isinstance(given, Office):
        return given.grid
    if isinstance(given, str | os.PathLike):
        return _read({"file": given})
    if not isinstance(given, Mapping):
        raise InputError(
            f"floor_plan is {shown(given)}, but must be a map, the path of a map's file, or a "
            f"mapping of {', '.join(polygon_file.KEYS)}, of file and unknown, or of office and "
            "form."
        )
    if "office" in given:
        return _office(given)
    if "file" in given:
        return _read(given)
    return polygon_file.of_mapping(given)


def _read(given: Mapping[str, Any]) -> Map:
    """Return the map in a file: a yaml of ROS, or polygons as JSON."""
    path = given["file"]
    polygons = str(path).endswith(".json")
    for key in given:
        one_of("key in floor_plan", key, ("file",) if polygons else ("file", "unknown"))
    if polygons:
        return polygon_file.read(path)
    return GridMap.load(path, given.get("unknown", "obstacle"))


def _office(given: Mapping[str, Any]) -> Map:
    for key in given:
        one_of("key in floor_plan", key, ("office", "form"))
    office: Office = part("floor_plan.office", Office, given["office"], Office())
    form = one_of("form of a floor plan", given.get("form", "grid"), ("grid", "polygons"))
    return office.grid if form == "grid" else office.polygons
