"""manifest.json: what a folder of results is of. A sweep resumes only in a folder of its own."""

import itertools
import json
import platform
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.files import write_text
from benchmarks.setup.names import scenario_digest
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.store import SCHEMA
from benchmarks.trials.plugins import source_digest
from benchmarks.trials.provenance import code_digest, environment, versions
from deqmcl_gym.validation import InputError

NAME = "manifest.json"

_ABSENT = object()
_SHOWN, _BEFORE = 60, 20  # letters of a long value, and how many of them are the same


def begin(folder: Path, sweep: Sweep, command: Sequence[str]) -> None:
    """Write the manifest of a new folder; in one that has its manifest, compare.

    A folder may grow: more worlds, runs and localizers are asked for than it was made for.

    Raises:
        InputError: the folder is of another sweep, other code or another plug-in; all differences
            are listed.
    """
    ours = identity(sweep)
    path = folder / NAME
    if path.exists():
        theirs = read(folder).get("identity")
        if theirs is None:
            raise InputError(f"{path} does not belong to a sweep: give a new --out.")
        if theirs == ours:
            return
        if differences := list(_differences(_less(theirs, ours), ours, "")):
            raise InputError(
                f"{folder} holds results of another run ({'; '.join(differences)}): give a new "
                "--out, or restore what was changed."
            )
    content = {
        "identity": ours,
        "command": list(command),
        "environment": environment(),
        "cpu": cpu_model(),
        "seeds": seeds(sweep.seed),
    }
    write_text(path, json.dumps(content, indent=2) + "\n")


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


def read(folder: Path) -> dict[str, Any]:
    """Return a folder's manifest.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    try:
        content = json.loads((folder / NAME).read_text())
    except FileNotFoundError:
        raise InputError(f"{folder} holds no {NAME}: give the folder of a sweep.") from None
    except (OSError, ValueError):
        content = None
    if not isinstance(content, dict):
        raise InputError(f"{folder / NAME} cannot be read: give a new --out.")
    return content


def identity(sweep: Sweep) -> dict[str, Any]:
    """Return everything that the numbers of a sweep depend on, as JSON-able values."""
    digests: dict[str, str] = {}
    for trial in sweep.cells():
        digests[trial.localizer] = source_digest(trial.localizer)
        digests[trial.scenario] = scenario_digest(trial.scenario)
    return {
        "schema": SCHEMA,
        "sweep": sweep.canonical(),
        "code": code_digest(),
        "libraries": versions(),
        "plug-ins": {name: digest for name, digest in digests.items() if digest},
    }


def seeds(root: int) -> dict[str, Any]:
    """Return the map from a trial to its random streams, in words."""
    return {
        "root": root,
        "world": "env.reset(seed) of trial i: "
        "SeedSequence(root, spawn_key=(i, 0)).generate_state(1, uint64)[0] >> 11",
        "localizer": "run j of trial i: SeedSequence(root, spawn_key=(i, 1, j)), the same for "
        "every method",
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


def _differences(theirs: Any, ours: Any, at: str) -> Iterator[str]:
    """Say where two JSON values differ; lists of one length are compared item by item."""
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for key in dict.fromkeys([*theirs, *ours]):
            inner = f"{at}.{key}" if at else key
            yield from _differences(theirs.get(key, _ABSENT), ours.get(key, _ABSENT), inner)
    elif isinstance(theirs, list) and isinstance(ours, list) and len(theirs) == len(ours):
        for number, pair in enumerate(zip(theirs, ours, strict=True), 1):
            yield from _differences(*pair, f"{at}[{number}]")
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
