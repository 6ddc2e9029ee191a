"""Maps of polygons as JSON: ``{"outer": [[x, y], …], "obstacles": [[[x, y], …], …], "unit": "m"}``.

The keys are those of ``floor_plan`` in Python and in TOML.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deqmcl_gym.files import UnreadableError, content_of, json_of
from deqmcl_gym.maps.polygon_map import PolygonMap
from deqmcl_gym.validation import InputError, one_of

KEYS = ("outer", "obstacles", "unit")


def read(path: str | os.PathLike[str]) -> PolygonMap:
    """Read a map.

    Raises:
        InputError: the file is missing or damaged, or has a bad value.
    """
    try:
        given = json_of(content_of(Path(path).expanduser()))
    except FileNotFoundError:
        raise InputError(f"the map file {path} does not exist: give one that does.") from None
    except UnreadableError as error:
        raise InputError(f"the map file {path} {error}.") from None
    try:
        for key in given:
            one_of("key", key, KEYS)
        return of_mapping(given)
    except InputError as error:
        raise InputError(f"the map {path}: {error}") from None


def of_mapping(given: Any) -> PolygonMap:
    """Return the map that a mapping describes."""
    if not isinstance(given, Mapping):
        kind = type(given).__name__
        raise InputError(f"it is a {kind}, but must be a mapping of {', '.join(KEYS)}.")
    for key in given:
        one_of("key in floor_plan", key, (*KEYS, "file", "office"))
    return PolygonMap(**{"outer": None, **given})


def text_of(floor_plan: PolygonMap) -> str:
    """Return a map as JSON, one polygon per line."""
    outer, unit = json.dumps(floor_plan.outer), json.dumps(floor_plan.unit)
    obstacles = ",\n".join(map(json.dumps, floor_plan.obstacles))
    return f'{{"unit": {unit},\n"outer": {outer},\n"obstacles": [\n{obstacles}\n]}}\n'
