"""Localizers that installed packages offer, by entry points of the group ``deqmcl.localizers``."""

import re
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions

GROUP = "deqmcl.localizers"


def installed() -> dict[str, str]:
    """References by name of the entry points of our group; none is loaded.

    A name that several packages offer differently has all their references, joined by " and ".
    """
    found: dict[str, set[str]] = {}
    for distribution in _first_of_each_name():
        for name, reference in _offered(distribution) or ():
            found.setdefault(name, set()).add(reference)
    return {name: " and ".join(sorted(references)) for name, references in sorted(found.items())}


def unreadable() -> list[str]:
    """Names of the installed packages whose entry points cannot be read."""
    return sorted(_name(own) for own in _first_of_each_name() if _offered(own) is None)


def _first_of_each_name() -> Iterator[Distribution]:
    """Yield what is installed; of two with one name the first, which Python imports."""
    seen = set()
    for distribution in distributions():
        name = re.sub(r"[-_.]+", "-", _name(distribution)).lower()
        if name not in seen:
            seen.add(name)
            yield distribution


def _name(distribution: Distribution) -> str:
    try:
        return distribution.metadata["Name"] or repr(distribution)
    except Exception:  # no metadata, or none that can be read
        return repr(distribution)


def _offered(distribution: Distribution) -> list[tuple[str, str]] | None:
    """Return a package's localizers as (name, reference); None if its list cannot be read.

    One package at a time: another one's mistake in a file of its own must not stop us.
    """
    try:
        return [
            (entry.name, entry.value.partition("[")[0].strip())
            for entry in distribution.entry_points
            if entry.group == GROUP and entry.name
        ]
    except Exception:  # a file that is malformed, no UTF-8, no file
        return None
