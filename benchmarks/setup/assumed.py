"""A part of what filters assume (motion, scan, prior), changed by its keys or to another kind."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from deqmcl_gym.maps.map import pixel, scaled
from deqmcl_gym.validation import InputError, one_of
from localizers.models.nav2_motion import unknown_motion
from localizers.scan_plug_in import ScanPlugIn, is_code

T = TypeVar("T")


def changed(part: str, current: T, keys: Any, unit: str, kinds: Mapping[str, Any]) -> T:
    """Change values of a part; another kind keeps those that both kinds have.

    Args:
        part: its name, for refusals.
        current: the part.
        keys: new values, by name; ``kind`` is one of ``kinds``, or of a scan model its code.
        unit: of lengths on the map, in which those of a fresh kind are.
        kinds: classes of such parts, by name.

    Raises:
        InputError: unknown name or a bad value.
    """
    if not isinstance(keys, Mapping):
        names = ", ".join(_names(part, current))
        raise InputError(f"{part} is {keys!r}, but must name a key: {names}.")
    changes = dict(keys)
    if part == "scan" and is_code(changes.get("kind")):
        return ScanPlugIn(kind=changes.pop("kind")).changed(**changes)  # type: ignore[return-value]
    if isinstance(current, ScanPlugIn) and "kind" not in changes:
        return current.changed(**changes)  # type: ignore[return-value]
    if "kind" in changes:
        given = _kind(part, changes.pop("kind"), kinds)
        kind = kinds[given]
        if not isinstance(current, kind):
            known = {own.name for own in fields(kind)}
            shared = {name: value for name, value in vars(current).items() if name in known}
            motion = part == "motion"
            fresh: Any = unknown_motion(given, unit) if motion else scaled(kind(), pixel(unit))
            current = replace(fresh, **shared)
    for key in changes:
        one_of("assumption", f"{part}.{key}", _names(part, current))
    return replace(current, **changes)  # type: ignore[type-var]


def _kind(part: str, given: Any, kinds: Mapping[str, Any]) -> str:
    try:
        return one_of(f"kind of {part}", given, kinds)
    except InputError as error:
        if part != "scan":
            raise
        raise InputError(f"{str(error).rstrip('.')}, or your own as file.py:NAME.") from None


def _names(part: str, current: Any) -> list[str]:
    """Dotted names of what can be changed of a part."""
    return [f"{part}.{name}" for name in (*(own.name for own in fields(current)), "kind")]
