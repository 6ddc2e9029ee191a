"""manifest.json: which sweep a folder belongs to. A sweep resumes only in its own folder."""

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct, field, to_builtins
from msgspec.structs import replace

from benchmarks.setup.overrides import renamed, spelt
from benchmarks.sweeps import Sweep
from benchmarks.sweeps.store import is_empty
from benchmarks.trials import Environment, Provenance, environment
from benchmarks.trials.stage import provenance_of
from deqmcl_gym.files import UnreadableError, content_of, json_of, typed, write_text
from deqmcl_gym.validation import InputError, shown
from localizers.digests import UNREAD
from localizers.kinds import Placed

MANIFEST = "manifest.json"
SCHEMA = 4

_FREE = ("title", "until_decided")  # parts of a sweep on which no trial depends
_ABSENT = object()
_DIGITS = 12  # of a digest


class Verified(Provenance, frozen=True, kw_only=True):
    """Other code, libraries or plug-ins with the same results in ``keys``, of so many trials."""

    keys: list[str] = field(name="verified")
    of: int
    environment: Environment

    def words(self) -> str:
        """Say under what, and by how many trials."""
        plug_ins = [f"{Path(name).name} {d[:_DIGITS]}" for name, d in self.plug_ins.items()]
        parts = [f"code {self.code[:_DIGITS]}", *map(" ".join, self.libraries.items()), *plug_ins]
        return f"verified under {', '.join(parts)} on {len(self.keys):,} of {self.of:,} trials"


class Identity(Provenance, frozen=True, kw_only=True):
    """Everything that the numbers of a folder depend on; ``sweep`` is ``Sweep.canonical()``."""

    sweep: dict[str, Any]


class Manifest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Which sweep a folder belongs to; read as data: nothing that it names is loaded."""

    schema: int
    identity: Identity
    parameters: dict[str, list[str] | None]  # those that each localizer takes; None: any
    command: list[str]  # the words that started the sweep
    environment: Environment
    places: dict[str, str] = field(default_factory=dict)  # of files, by their name in a sweep file
    margin: float | None = None  # by which comparisons were decided; None: all worlds were run
    verified: list[Verified] = field(default_factory=list)  # what else may go on with its trials

    @property
    def placed(self) -> dict[str, Any]:
        """The sweep, with names that lead to where the files are."""
        names = {name: Placed(name, place) for name, place in self.places.items()}
        return renamed(self.identity.sweep, names)  # type: ignore[no-any-return]


def manifest_of(sweep: Sweep, command: Sequence[str]) -> Manifest:
    """Return the manifest that a sweep has if it is run now."""
    cells = [*sweep.cells()]
    now, taken = provenance_of(cells), {name: sweep.takes(name) for name in sweep.names}
    files = [name for trial in cells for name in trial.named if isinstance(name, Placed)]
    return Manifest(
        schema=SCHEMA,
        identity=Identity(now.code, now.libraries, now.plug_ins, sweep=sweep.canonical()),
        parameters={str(n): None if names is None else list(names) for n, names in taken.items()},
        command=list(command),
        environment=environment(),
        places={str(name): name.place for name in files},
        margin=sweep.until_decided,
    )


def taken_over(folder: Path, ours: Manifest) -> Manifest:
    """Return a sweep's manifest as it goes on in a folder that is new, empty, or of this sweep.

    A folder may grow: more worlds, runs and localizers are asked for than it was made for. Its
    trials keep their keys if this code, these libraries and plug-ins made them or were verified.
    """
    if is_empty(folder):
        return ours
    theirs = read_manifest(folder)
    made, now, before = ours, ours.identity, theirs.identity
    for checked in theirs.verified:
        plug_ins = {**before.plug_ins, **checked.plug_ins}
        same = plug_ins.items() <= now.plug_ins.items()
        if same and (checked.code, checked.libraries) == (now.code, now.libraries):
            plug_ins = {**now.plug_ins, **before.plug_ins}
            identity = replace(before, plug_ins=plug_ins, sweep=ours.identity.sweep)
            made = replace(ours, identity=identity, environment=theirs.environment)
            break
    margin = ours.margin if theirs.margin is None else theirs.margin
    made = replace(made, verified=theirs.verified, margin=margin)
    grown = _grown(before, made.identity)
    if changes := list(differences(_plain(grown), _plain(made.identity))):
        same = not any(differences(grown.sweep, made.identity.sweep))
        others = f", or see by deqmcl verify {folder} whether any number differs" if same else ""
        raise InputError(
            f"{folder} holds results of something else ({'; '.join(changes)}): give a new --out, "
            f"or restore what was changed{others}."
        )
    if ours.margin not in (None, margin):
        raise InputError(
            f"{folder} was looked at with --margin {100 * (margin or 0.0):g}%, and a margin "
            f"that is chosen after a look, {100 * ours.margin:g}%, decides nothing: give that of "
            "before, or a new --out."
        )
    if unread := [name for name, digest in before.plug_ins.items() if UNREAD in digest]:
        raise InputError(
            f"{folder} holds results of {unread[0]!r}, whose code cannot be read, so nobody knows "
            "whether it is the same now: give a new --out, or write it into a file.py."
        )
    return made


def _grown(theirs: Identity, ours: Identity) -> Identity:
    """Return an identity as if it had been asked for our worlds, runs, localizers and title."""
    held, asked = theirs.sweep, ours.sweep
    try:
        more = {name: max(asked[name], held[name]) for name in ("trials", "filter_seeds")}
        if {*map(spelt, held["localizers"])} <= {*map(spelt, asked["localizers"])}:
            more["localizers"] = asked["localizers"]
            theirs = replace(theirs, plug_ins={**ours.plug_ins, **theirs.plug_ins})
    except (KeyError, TypeError):  # it is not as we write it
        return theirs
    free = {name: value for name, value in asked.items() if name in _FREE}
    bound = {name: value for name, value in held.items() if name not in _FREE}
    return replace(theirs, sweep=bound | free | more)


def begin(folder: Path, ours: Manifest) -> Manifest:
    """Write the manifest of a new folder, or of one that grows, and return it."""
    made = taken_over(folder, ours)
    held = None if is_empty(folder) else read_manifest(folder)
    if held is None or (held.identity, held.places) != (made.identity, made.places):
        _write(folder, made)
    return made


def append(folder: Path, checked: Verified) -> None:
    """Add to a folder's manifest what was verified."""
    held = read_manifest(folder)
    _write(folder, replace(held, verified=[*held.verified, checked]))


def _write(folder: Path, made: Manifest) -> None:
    places = {name: os.path.relpath(place, folder) for name, place in made.places.items()}
    content = _plain(replace(made, places=places))
    write_text(folder / MANIFEST, json.dumps(content, indent=2) + "\n")


def _plain(value: Struct) -> dict[str, Any]:
    return to_builtins(value, enc_hook=str)  # type: ignore[no-any-return]  # ``Placed``


def read_manifest(folder: Path) -> Manifest:
    """Return a folder's manifest."""
    path, again = folder / MANIFEST, "give a new --out"
    try:
        content = json_of(content_of(path))
    except FileNotFoundError:
        raise InputError(
            f"{folder} holds no {MANIFEST} of a sweep: give the folder of a sweep or replay."
        ) from None
    except UnreadableError as error:
        raise InputError(f"{path} {error}: restore it, or {again}.") from None
    schema = content.get("schema")
    if isinstance(schema, int) and schema != SCHEMA:
        raise InputError(
            f"{folder} was written by {'an older' if schema < SCHEMA else 'a newer'} version of "
            f"deqmcl-gym (schema {schema}, this one has {SCHEMA}): use that version, or {again}."
        )
    try:
        held = typed(content, Manifest)
    except UnreadableError as error:
        raise InputError(
            f"{path} {error}: it is not of a sweep, or was changed; {again}."
        ) from None
    until = held.identity.sweep.get("until_decided")
    return replace(
        held,
        margin=until.get("margin") if isinstance(until, dict) else held.margin,
        places={n: os.path.abspath(folder / place) for n, place in held.places.items()},
    )


def differences(theirs: Any, ours: Any, at: str = "") -> Iterator[str]:
    """Say where two JSON values differ; lists of one length are compared item by item."""
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for key in dict.fromkeys([*theirs, *ours]):
            inner = f"{at}.{key}" if at else key
            yield from differences(theirs.get(key, _ABSENT), ours.get(key, _ABSENT), inner)
    elif isinstance(theirs, list) and isinstance(ours, list) and len(theirs) == len(ours):
        for number, pair in enumerate(zip(theirs, ours, strict=True), 1):
            yield from differences(*pair, f"{at}[{number}]")
    elif spelt(theirs) != spelt(ours):
        was, now = ("not set" if value is _ABSENT else shown(value) for value in (theirs, ours))
        yield f"{at.removeprefix('sweep.')} was {was} and is {now}"
