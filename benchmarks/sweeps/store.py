"""Results on disk: one file per trial, finished or failed, written whole or not at all."""

import hashlib
import json
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from benchmarks.files import (
    UnreadableError,
    content_of,
    is_temporary,
    json_of,
    misfit,
    writable_folder,
    write_text,
)
from benchmarks.trials.journeys import JOURNEY_SCORES
from benchmarks.trials.plans import SIGNALS
from benchmarks.trials.scoring import SCORE_NAMES
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError

SCHEMA = 4

FOLDERS = ("trials", "timings", "failed")
_NUMBER = (float, type(None))
_SHAPES = {
    "trials": {
        "trial": dict,
        "unit": str,
        "thresholds": {str: float},
        "scores": [{"offset": int} | dict.fromkeys(SCORE_NAMES, _NUMBER)],
        "curves": {str: {"first_state": int, "error": [_NUMBER]}},
        "quality": ([_NUMBER], type(None)),
        "profile": {str: float},
        "steps_done": int,
        "scans_used": int,
        "events": {str: int},
    },
    "timings": {"seconds": float},
    "failed": {"trial": dict, "reason": str},
}


class Store:
    """Trials in a folder, by key; timings apart, as they alone depend on the machine.

    A file carries its schema, its key and a checksum of its content. One that is torn, edited or
    of something else counts as missing. The checksum finds accidents: who changes a file on purpose
    can make it anew.

    Attributes:
        out: the folder.
        rejected: files that were not taken for what they should be, and why.
    """

    def __init__(self, out: Path, *, reading: bool = False) -> None:
        """Open ``out`` (made if missing), or look at what is there if it is only read.

        Raises:
            InputError: it is to be written to, and is a file or cannot be.
        """
        self.out = out if reading else writable_folder(out)
        self.rejected: dict[str, str] = {}

    def get(self, key: str, trial: Trial) -> dict[str, Any] | None:
        """Return a finished trial's record, with its key and timing; None if missing or rejected.

        The timing is None if it is not known.
        """
        record = self._read("trials", key, trial)
        if record is None:
            return None
        timing = self._read("timings", key) or {}
        return record | {"key": key, "seconds": timing.get("seconds")}

    def put(self, key: str, record: dict[str, Any], seconds: float) -> None:
        """Keep a finished trial. The timing goes first: a trial that is there is complete.

        Raises:
            ValueError: it is no record, or holds a number that is not finite.
        """
        self._write("timings", key, {"seconds": seconds})
        self._write("trials", key, record)
        self._path("failed", key).unlink(missing_ok=True)

    def failure(self, key: str, trial: Trial) -> str | None:
        """Return the reason why a trial failed; None if it did not."""
        content = self._read("failed", key, trial)
        return None if content is None else str(content["reason"])

    def put_failure(self, key: str, trial: Trial, reason: str) -> None:
        """Keep the reason why a trial failed."""
        self._write("failed", key, {"trial": trial.canonical(), "reason": reason})

    def refuse_obstacles(self, keys: Collection[str]) -> None:
        """Refuse a folder where something that is no file is in the way of one of ours.

        Raises:
            InputError: naming it.
        """
        for name in FOLDERS:
            folder = self.out / name
            if os.path.lexists(folder) and (folder.is_symlink() or not folder.is_dir()):
                raise InputError(f"{folder} is in the way of a folder of that name: move it away.")
            for path in folder.glob("*.json"):
                if path.stem in keys and (path.is_symlink() or not path.is_file()):
                    raise InputError(f"{path} is in the way of a file of that name: move it away.")

    def temporary(self) -> list[Path]:
        """Return what interrupted writes have left in the folders of trials, and beside them."""
        folders = [self.out, *(self.out / name for name in FOLDERS)]
        return sorted(p for folder in folders for p in folder.glob(".*") if is_temporary(p))

    def left_out(self, keys: Collection[str], asked: Collection[str]) -> Iterator[tuple[str, str]]:
        """Yield the files that belong to none of these keys, and why.

        Args:
            keys: of the trials asked for.
            asked: the same trials as ``named``.
        """
        for name in ("trials", "failed"):
            for path in sorted((self.out / name).glob("*")):
                if is_temporary(path) or (path.stem in keys and path.suffix == ".json"):
                    continue
                why = "is no file of a trial"
                if path.suffix == ".json":
                    try:
                        trial = _checked(path, name, path.stem)["trial"]
                        same = named(trial) in asked
                        why = f"is of {'other code, libraries or plug-ins' if same else NOT_ASKED}"
                    except (UnreadableError, FileNotFoundError) as error:
                        why = str(error)
                yield f"{name}/{path.name}", why

    def _path(self, folder: str, key: str) -> Path:
        return self.out / folder / f"{key}.json"

    def _write(self, folder: str, key: str, content: dict[str, Any]) -> None:
        if why := _unlike(content, folder):
            raise ValueError(why)
        signed = {"schema": SCHEMA, "key": key} | content
        write_text(self._path(folder, key), _json(signed | {"checksum": _checksum(signed)}))

    def _read(self, folder: str, key: str, trial: Trial | None = None) -> dict[str, Any] | None:
        path = self._path(folder, key)
        try:
            content = _checked(path, folder, key)
            if trial is not None and content["trial"] != trial.canonical():
                raise UnreadableError("is of another trial")
        except FileNotFoundError:
            return None
        except UnreadableError as error:
            self.rejected[f"{folder}/{path.name}"] = str(error)
            return None
        return content


NOT_ASKED = "a trial that this sweep does not have"


def named(canonical: dict[str, Any]) -> str:
    """Return a canonical trial as a text that is the same for the same one."""
    return json.dumps(canonical, sort_keys=True)


def _checked(path: Path, folder: str, key: str) -> dict[str, Any]:
    """Return the content of a file if it is whole, ours, and as it was written."""
    content = json_of(content_of(path))
    if (schema := content.get("schema")) != SCHEMA:
        raise UnreadableError(f"has schema {str(schema)[:20]}, not {SCHEMA}")
    if content.get("key") != key:
        raise UnreadableError("is of another trial")
    given = content.pop("checksum", None)
    try:
        expected = _checksum(content)
    except ValueError:  # 1e999 is valid JSON
        raise UnreadableError("holds a number that is infinite") from None
    if given != expected:
        raise UnreadableError("was changed after it was written: its checksum does not match")
    del content["schema"], content["key"]
    if why := _unlike(content, folder):
        raise UnreadableError(f"{why}, as no trial has")
    return content


def _unlike(content: dict[str, Any], folder: str) -> str | None:
    """Say where the content of a file differs from what is kept in its folder."""
    why = misfit(content, _SHAPES[folder])
    if why or folder != "trials":
        return why
    steps, quality = content["steps_done"], content["quality"]
    lengths = [len(curve["error"]) for curve in content["curves"].values()]
    if {str(row["offset"]) for row in content["scores"]} != content["curves"].keys() or not lengths:
        return "has scores and curves of other offsets"
    if not all(0 < length <= steps + 1 for length in lengths) or len(quality or ()) > steps:
        return f"has a curve or qualities of another length than its {str(steps)[:20]} steps"
    if not all(key.removeprefix("-").isdecimal() for key in content["profile"]):
        return "has a profile of no offsets"
    why = _unlike_journey(content.get("journey"), steps)
    return why or _unlike_plan(content.get("plan"), steps)


def _unlike_journey(journey: Any, steps: int) -> str | None:
    """Say where the scores and curves of the whole run, if it has any, are not as they are kept."""
    if journey is None:
        return None
    why = misfit(journey, {"scores": {str: _NUMBER}, "curves": {str: [float]}}, "journey")
    if why:
        return why
    if other := journey["scores"].keys() - JOURNEY_SCORES.keys():
        return f"has a score of the whole run named {min(other)[:20]!r}"
    lengths = {len(curve) for curve in journey["curves"].values()}
    if "way" not in journey["curves"] or len(lengths) != 1 or not 0 < max(lengths) <= steps + 1:
        return f"has curves of the whole run of another length than its {str(steps)[:20]} steps"
    return None


def _unlike_plan(plan: Any, steps: int) -> str | None:
    """Say where what was made of plans, if any was read, is not as it is kept."""
    if plan is None:
        return None
    why = misfit(plan, {name: [_NUMBER] for name in ("conflict", *SIGNALS)}, "plan")
    if why is None and any(len(column) != steps for column in plan.values()):
        return f"has readings of the plan of another length than its {str(steps)[:20]} steps"
    return why


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(_json(content).encode()).hexdigest()


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"), sort_keys=True) + "\n"
