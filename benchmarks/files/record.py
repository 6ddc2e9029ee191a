"""Files that are made again only if what they are made of, or one of them, has changed."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.files.writing import write_text


def written(record: Path, source: str, write: Callable[[], list[Path]]) -> list[Path]:
    """Return the files that ``write`` makes of ``source``; call it only if they are not there.

    Those made earlier that are no longer made are removed.

    Args:
        record: file beside or above them, which says what they were made of.
        source: names all that they are made of, and what makes them.
        write: writes the files and returns them.
    """
    content = _read(record)
    earlier = {record.parent / name: digest for name, digest in content["files"].items()}
    if content["source"] == source and all(_digest(p) == d for p, d in earlier.items()):
        return list(earlier)
    files = write()
    for path in earlier.keys() - set(files):
        path.unlink(missing_ok=True)
    digests = {path.relative_to(record.parent).as_posix(): _digest(path) for path in files}
    write_text(record, json.dumps({"source": source, "files": digests}, indent=2) + "\n")
    return files


def _read(record: Path) -> dict[str, Any]:
    """Return a record; an empty one if there is none, it is not ours, or it leads elsewhere."""
    try:
        content = json.loads(record.read_text(encoding="utf-8"))
        source, files = str(content["source"]), dict(content["files"])
        inside = all(".." not in Path(name).parts for name in files)
        if inside and not any(Path(name).is_absolute() for name in files):
            return {"source": source, "files": files}
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return {"source": "", "files": {}}


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
