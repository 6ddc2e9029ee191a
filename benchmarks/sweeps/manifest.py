"""manifest.json: which sweep a folder belongs to. A sweep resumes only in its own folder."""

import itertools
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import Struct, field, to_builtins

from benchmarks.files import is_empty, refuse_changed
from benchmarks.setup.changes import renamed, spelt
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.store import SCHEMA
from benchmarks.trials.plugins import provenance_of
from benchmarks.trials.provenance import Environment, Provenance, environment
from deqmcl_gym.files import UnreadableError, content_of, json_of, typed, write_text
from deqmcl_gym.validation import InputError
from localizers.digests import UNREAD
from localizers.kinds import Placed

NAME = "manifest.json"

_ABSENT = object()
_DIGITS = 12  # of a digest
_SHOWN, _BEFORE = 60, 20  # letters of a long value, and how many of them are the same


class Verified(Provenance, frozen=True, kw_only=True):
    """Other code, libraries or plug-ins that got the same results; see ``verifying``.

    Attributes:
        keys: trials that were run again.
        of: how many were finished then.
        environment: see ``provenance.environment``.
    """

    keys: list[str] = field(name="verified")
    of: int
    environment: Environment

    def words(self) -> str:
        """Say under what, and by how many trials."""
        own = [f"{Path(name).name} {d[:_DIGITS]}" for name, d in self.plug_ins.items()]
        named = [f"code {self.code[:_DIGITS]}", *map(" ".join, self.libraries.items())]
        under = ", ".join([*named, *own])
        return f"verified under {under} on {len(self.keys):,} of {self.of:,} trials"


class _Identity(Provenance, frozen=True, kw_only=True):
    """What the numbers of a folder depend on, as its manifest has it."""

    sweep: dict[str, Any]


class _Content(Struct):
    """The content of a manifest."""

    schema: int
    identity: _Identity
    parameters: dict[str, list[str] | None]
    command: list[str]
    environment: Environment
    verified: list[Verified] = field(default_factory=list)
    places: dict[str, str] = field(default_factory=dict)
    margin: float | None = None


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """Which sweep a folder belongs to; read as data: nothing that it names is loaded.

    Attributes:
        sweep: ``Sweep.canonical()``.
        made: code, libraries and plug-ins of its trials.
        parameters: those that each localizer takes; None: any.
        command: the words that started the sweep.
        environment: see ``provenance.environment``.
        verified: what else may go on with the trials of ``made``, under their keys.
        places: where the files are that a sweep file named, by the names that it has for them.
        margin: by which comparisons were looked at until they were decided; None: none was.
    """

    sweep: dict[str, Any]
    made: Provenance
    parameters: Mapping[str, Sequence[str] | None]
    command: Sequence[str]
    environment: Environment
    verified: Sequence[Verified] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    margin: float | None = None

    @property
    def placed(self) -> dict[str, Any]:
        """The sweep, with names that lead to where the files are."""
        names = {name: Placed(name, place) for name, place in self.places.items()}
        return renamed(self.sweep, names)  # type: ignore[no-any-return]

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that the numbers depend on."""
        return {"sweep": self.sweep, **to_builtins(self.made)}


def of_sweep(sweep: Sweep, command: Sequence[str]) -> Manifest:
    """Return the manifest that a sweep has if it is run now."""
    return Manifest(
        sweep=sweep.canonical(),
        made=provenance_of(sweep.cells()),
        parameters={name: sweep.takes(name) for name in sweep.names},
        command=command,
        environment=environment(),
        places=places(sweep),
        margin=None if sweep.until_decided is None else sweep.until_decided.margin,
    )


def places(sweep: Sweep) -> dict[str, str]:
    """Return where the files are that a sweep file named, by the names that it has for them."""
    named = (name for trial in sweep.cells() for name in trial.named)
    return {str(name): name.place for name in named if isinstance(name, Placed)}


def taken_over(folder: Path, ours: Manifest) -> Manifest:
    """Return a sweep's manifest as it goes on in a folder that is new, empty, or of this sweep.

    A folder may grow: more worlds, runs and localizers are asked for than it was made for. Its
    trials keep their keys if this code, these libraries and plug-ins made them or were verified.

    Raises:
        InputError: the folder is not ours, or of another sweep, other code or another plug-in
            (all differences are listed), or of one that cannot be read; it was looked at with
            another margin; or a file in it was changed.
    """
    if is_empty(folder):
        return ours
    held, made = _compared(folder, ours)
    if apart := list(differences(held, made.identity)):
        others = f", or see by deqmcl verify {folder} whether any number differs"
        raise InputError(
            f"{folder} holds results of something else ({'; '.join(apart)}): give a new --out, or "
            f"restore what was changed{others if held['sweep'] == made.sweep else ''}."
        )
    if ours.margin not in (None, made.margin):
        raise InputError(
            f"{folder} was looked at with --margin {100 * (made.margin or 0.0):g}%, and a margin "
            f"that is chosen after a look, {100 * ours.margin:g}%, decides nothing: give that of "
            "before, or a new --out."
        )
    for name, digest in read(folder).made.plug_ins.items():
        if UNREAD in digest:
            raise InputError(
                f"{folder} holds results of {name!r}, whose code cannot be read, so nobody knows "
                "whether it is the same now: give a new --out, or write it into a file.py."
            )
    refuse_changed(folder)
    return made


def is_of_other_code(folder: Path, ours: Manifest) -> bool:
    """Whether a folder is of this sweep, but of code, libraries or plug-ins not known to agree."""
    if is_empty(folder):
        return False
    held, made = _compared(folder, ours)
    return not any(differences(held["sweep"], made.sweep)) and held != made.identity


def _compared(folder: Path, ours: Manifest) -> tuple[dict[str, Any], Manifest]:
    """Return what a folder is of, as far as ours may not grow from it, and ours as it goes on."""
    theirs = read(folder)
    made = _under_keys_of(theirs, ours)
    return _less(theirs.identity, made.identity), made


def _under_keys_of(theirs: Manifest, ours: Manifest) -> Manifest:
    """Return our manifest with the provenance of theirs, if ours was verified to be as good."""
    now, before = ours.made, theirs.made
    for one in theirs.verified:
        known = {**before.plug_ins, **one.plug_ins}
        same = all(now.plug_ins.get(name) == digest for name, digest in known.items())
        if same and (one.code, one.libraries) == (now.code, now.libraries):
            plug_ins = {**now.plug_ins, **before.plug_ins}
            made = Provenance(before.code, before.libraries, plug_ins)
            ours = replace(ours, made=made, environment=theirs.environment)
            break
    margin = ours.margin if theirs.margin is None else theirs.margin
    return replace(ours, verified=theirs.verified, margin=margin)


def begin(folder: Path, ours: Manifest) -> tuple[Manifest, bool]:
    """Write the manifest of a new folder, or of one that grows; return it, and whether it is new.

    Raises:
        InputError: see ``taken_over``.
    """
    ours, new = taken_over(folder, ours), is_empty(folder)
    here = {name: os.path.relpath(place, folder) for name, place in ours.places.items()}
    if new or (held := read(folder)).identity != ours.identity or held.places != ours.places:
        content = {
            "schema": SCHEMA,
            "identity": ours.identity,
            "parameters": ours.parameters,
            "command": ours.command,
            "environment": ours.environment,
            "cpu": cpu_model(),
            "seeds": seeds(ours.sweep["seed"]),
        }
        if here:
            content["places"] = here
        if ours.margin is not None:
            content["margin"] = ours.margin
        if ours.verified:
            content["verified"] = to_builtins(ours.verified)
        write_text(folder / NAME, json.dumps(content, indent=2) + "\n")
    return ours, new


def append(folder: Path, made: Verified) -> None:
    """Add to a folder's manifest what was verified."""
    path = folder / NAME
    content = json_of(content_of(path))
    content["verified"] = [*content.get("verified", ()), to_builtins(made)]
    write_text(path, json.dumps(content, indent=2) + "\n")


def _less(theirs: Any, ours: dict[str, Any]) -> Any:
    """Return an identity as if it were ours, but for more worlds or localizers and the title."""
    try:
        held, asked = theirs["sweep"], ours["sweep"]
        more = {"title": asked["title"]} | {
            name: asked[name] for name in ("trials", "filter_seeds") if asked[name] > held[name]
        }
        held = {key: value for key, value in held.items() if key != "until_decided"}
        more |= {key: asked[key] for key in asked if key == "until_decided"}
        if {*map(spelt, held["localizers"])} <= {*map(spelt, asked["localizers"])}:
            more["localizers"] = asked["localizers"]
            theirs = theirs | {"plug-ins": ours["plug-ins"] | theirs["plug-ins"]}
        return theirs | {"sweep": held | more}
    except (KeyError, TypeError):  # it is not as we write it
        return theirs


def read(folder: Path) -> Manifest:
    """Return a folder's manifest.

    Raises:
        InputError: there is none, it cannot be read, or it is not as this version writes it.
    """
    path = folder / NAME
    try:
        content = json_of(content_of(path))
    except FileNotFoundError:
        raise InputError(
            f"{folder} holds no {NAME} of a sweep: give the folder of a sweep, or a new one."
        ) from None
    except UnreadableError as error:
        raise InputError(f"{path} {error}: restore it, or give a new --out.") from None
    schema = content.get("schema")
    if isinstance(schema, int) and schema != SCHEMA:
        raise InputError(
            f"{folder} was written by {'an older' if schema < SCHEMA else 'a newer'} version of "
            f"deqmcl-gym (schema {schema}, this one has {SCHEMA}): use that version, or give a new "
            "--out."
        )
    try:
        known = typed(content, _Content)
    except UnreadableError as error:
        raise InputError(
            f"{path} {error}: it is not of a sweep, or was changed; give a new --out."
        ) from None
    identity, until = known.identity, known.identity.sweep.get("until_decided")
    identity.sweep.pop("held_out", None)  # where a seed came from, once; it is ``seed`` itself
    return Manifest(
        sweep=identity.sweep,
        made=Provenance(identity.code, identity.libraries, identity.plug_ins),
        parameters=known.parameters,
        command=known.command,
        environment=known.environment,
        verified=known.verified,
        margin=until.get("margin") if isinstance(until, dict) else known.margin,
        places={n: os.path.abspath(folder / place) for n, place in known.places.items()},
    )


def seeds(root: int) -> dict[str, Any]:
    """Return the map from a trial to its random streams, in words."""
    return {
        "root": root,
        "world": "env.reset(seed) of trial i: "
        "SeedSequence(root, spawn_key=(i, 0)).generate_state(1, uint64)[0] >> 11",
        "localizer": "run j of trial i: SeedSequence(root, spawn_key=(i, 1, j)), the same for "
        "every method; in scenario replay: spawn_key=(i,) of run 0, (i, j) of the others",
        "start": "of a prior that is drawn, run j of trial i: "
        "SeedSequence(root, spawn_key=(i, 2, j))",
    }


def cpu_model() -> str:
    """Return the name of this machine's processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


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
        was, now = _shown(theirs, ours)
        yield f"{at.removeprefix('sweep.')} was {was} and is {now}"


def _shown(*values: Any) -> list[str]:
    """Return unequal JSON values as texts; long ones from shortly before they first differ."""
    texts = [
        "not set" if value is _ABSENT else json.dumps(value, ensure_ascii=False) for value in values
    ]
    same = itertools.takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    first = max(0, sum(1 for _ in same) - _BEFORE)
    last, before = first + _SHOWN, "…" * (first > 0)
    return [
        text if len(text) <= _SHOWN else f"{before}{text[first:last]}{'…' * (last < len(text))}"
        for text in texts
    ]
