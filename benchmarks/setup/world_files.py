"""The files that a world is read from: a map, a log, its reference."""

import os
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import yaml

from localizers.naming.digests import content_digest

FILES = ("floor_plan", "floor_plan.file", "log", "map", "reference")  # dotted names of a world


def beside(folder: Path, world: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a world, the paths among them absolute from a folder; ~ is home."""
    return {
        name: _absolute(folder, value) if name in FILES else value for name, value in world.items()
    }


def files_of(world: Mapping[str, Any]) -> list[str]:
    """Return the paths among the values of a world, by dotted name or nested."""
    found = [world[name] for name in FILES if name in world]
    if isinstance(plan := world.get("floor_plan"), Mapping):
        found.append(plan.get("file"))
    return [str(path) for path in found if isinstance(path, str | Path)]


def short(name: str, value: Any) -> Any:
    """Return a value of a world for a heading: of a file without its folder."""
    return Path(value).name if name in FILES and isinstance(value, str) else value


def file_digest(path: str) -> str:
    """Digest of a file of a world; that of a map covers its image, that of a folder all its files.

    A missing file has one, too: what reads the file reports it.
    """
    digest = sha256()
    for part in _parts(Path(path)):
        digest.update(f"{part.name}\0{content_digest(part)}\0".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _parts(path: Path) -> list[Path]:
    if path.is_dir():
        return sorted(part for part in path.rglob("*") if part.is_file())
    if path.suffix.lower() not in (".yaml", ".yml"):
        return [path]
    try:
        said = yaml.safe_load(path.read_bytes())
        image = said.get("image") if isinstance(said, dict) else None
    except (OSError, ValueError, yaml.YAMLError):  # whoever loads the map says so
        image = None
    return [path, path.parent / image] if isinstance(image, str) else [path]


def _absolute(folder: Path, value: Any) -> Any:
    if isinstance(value, list | tuple):  # of a [[vary]]
        return tuple(_absolute(folder, one) for one in value)
    if isinstance(value, Mapping):
        return {key: _absolute(folder, one) if key == "file" else one for key, one in value.items()}
    return os.path.abspath(folder / Path(value).expanduser()) if isinstance(value, str) else value
