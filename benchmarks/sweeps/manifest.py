"""manifest.json: which sweep a folder belongs to. A sweep resumes only in its own folder."""

import itertools
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.execution.apart import provenance
from benchmarks.files import (
    UnreadableError,
    content_of,
    is_empty,
    json_of,
    misfit,
    refuse_changed,
    write_text,
)
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.store import SCHEMA
from benchmarks.trials.provenance import Provenance, environment
from deqmcl_gym.validation import InputError

NAME = "manifest.json"

_ABSENT = object()
_SHOWN, _BEFORE = 60, 20  # letters of a long value, and how many of them are the same

_NAMED = {str: str}
_SHAPE = {
    "schema": int,
    "identity": {"sweep": dict, "code": str, "libraries": _NAMED, "plug-ins": _NAMED},
    "parameters": {str: ([str], type(None))},
    "command": [str],
    "environment": {str: (str, _NAMED)},
}


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """Which sweep a folder belongs to; read as data: nothing that it names is loaded.

    Attributes:
        sweep: ``Sweep.canonical()``.
        made: code, libraries and plug-ins of its trials.
        parameters: those that each localizer takes; None: any.
        command: the words that started the sweep.
        environment: see ``provenance.environment``.
    """

    sweep: dict[str, Any]
    made: Provenance
    parameters: Mapping[str, Sequence[str] | None]
    command: Sequence[str]
    environment: dict[str, Any]

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that the numbers depend on."""
        return {
            "sweep": self.sweep,
            "code": self.made.code,
            "libraries": dict(self.made.libraries),
            "plug-ins": dict(self.made.plug_ins),
        }


def of_sweep(sweep: Sweep, command: Sequence[str]) -> Manifest:
    """Return the manifest that a sweep has if it is run now."""
    return Manifest(
        sweep=sweep.canonical(),
        made=provenance(sweep.cells()),
        parameters={name: sweep.takes(name) for name in sweep.names},
        command=command,
        environment=environment(),
    )


def refuse_others(folder: Path, ours: Manifest) -> None:
    """Refuse a folder unless it is new, empty, or of this sweep.

    A folder may grow: more worlds, runs and localizers are asked for than it was made for.

    Raises:
        InputError: the folder is not ours, or of another sweep, other code or another plug-in
            (all differences are listed); or a file in it was changed.
    """
    if is_empty(folder):
        return
    theirs = read(folder).identity
    if apart := list(differences(_less(theirs, ours.identity), ours.identity)):
        raise InputError(
            f"{folder} holds results of something else ({'; '.join(apart)}): give a new "
            "--out, or restore what was changed."
        )
    refuse_changed(folder)


def begin(folder: Path, ours: Manifest) -> bool:
    """Write the manifest of a new folder, or of one that grows; return whether it is a new one.

    Raises:
        InputError: see ``refuse_others``.
    """
    refuse_others(folder, ours)
    new = is_empty(folder)
    if not new and read(folder).identity == ours.identity:
        return False
    content = {
        "schema": SCHEMA,
        "identity": ours.identity,
        "parameters": ours.parameters,
        "command": ours.command,
        "environment": ours.environment,
        "cpu": cpu_model(),
        "seeds": seeds(ours.sweep["seed"]),
    }
    write_text(folder / NAME, json.dumps(content, indent=2) + "\n")
    return new


def _less(theirs: Any, ours: dict[str, Any]) -> Any:
    """Return an identity as if it were ours, as far as ours has more worlds or localizers."""
    try:
        held, asked = theirs["sweep"], ours["sweep"]
        more = {
            name: asked[name] for name in ("trials", "filter_seeds") if asked[name] > held[name]
        }
        if all(method in asked["localizers"] for method in held["localizers"]):
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
    if why := misfit(content, _SHAPE):
        raise InputError(f"{path} {why}: it is not of a sweep, or was changed; give a new --out.")
    identity = content["identity"]
    return Manifest(
        sweep=identity["sweep"],
        made=Provenance(identity["code"], identity["libraries"], identity["plug-ins"]),
        parameters=content["parameters"],
        command=content["command"],
        environment=content["environment"],
    )


def seeds(root: int) -> dict[str, Any]:
    """Return the map from a trial to its random streams, in words."""
    return {
        "root": root,
        "world": "env.reset(seed) of trial i: "
        "SeedSequence(root, spawn_key=(i, 0)).generate_state(1, uint64)[0] >> 11",
        "localizer": "run j of trial i: SeedSequence(root, spawn_key=(i, 1, j)), the same for "
        "every method; in scenario replay: SeedSequence(root, spawn_key=(i,))",
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
    elif theirs != ours:
        was, now = _shown(theirs, ours)
        yield f"{at.removeprefix('sweep.')} was {was} and is {now}"


def _shown(*values: Any) -> list[str]:
    """Return unequal JSON values as texts; long ones from shortly before they first differ."""
    texts = [
        "not set" if value is _ABSENT else json.dumps(value, ensure_ascii=False) for value in values
    ]
    same = itertools.takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    first = max(0, sum(1 for _ in same) - _BEFORE)
    return [text if len(text) <= _SHOWN else _cut(text, first) for text in texts]


def _cut(text: str, first: int) -> str:
    last = first + _SHOWN
    return f"{'…' * (first > 0)}{text[first:last]}{'…' * (last < len(text))}"
