"""Read the results that stand in a folder, whatever version of the code has made them."""

import json
from pathlib import Path
from typing import Any

from benchmarks.provenance import environment
from benchmarks.results import Failure, Results
from benchmarks.store import Store
from benchmarks.suites import paper_suite
from deqmcl_gym.validation import InputError


def read_results(folder: Path) -> Results:
    """Return what a folder of ``deqmcl paper`` holds, in the order in which it was asked for.

    Raises:
        InputError: the folder is not one of results, or its manifest cannot be read.
    """
    manifest = _manifest(folder)
    planned = _planned(folder, manifest)
    found = _records(folder)
    failed = _failures(folder)
    keys = [_key(trial) for trial in planned]
    records = [found[key] for key in keys if key in found]
    failures = [
        Failure(trial=trial, reason=failed[key])
        for key, trial in zip(keys, planned, strict=True)
        if key in failed and key not in found
    ]
    return Results(
        title=f"The paper's experiment, preset {manifest['configuration']['preset']}",
        records=records,
        failures=failures,
        missing=len(planned) - len(records) - len(failures),
        planned=len(planned),
        command=list(manifest.get("command", [])),
        environment=manifest.get("environment") or environment(),
    )


def _manifest(folder: Path) -> dict[str, Any]:
    path = folder / "manifest.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{folder} holds no manifest.json: give a folder of results.") from None
    except (OSError, ValueError):
        content = None
    if not isinstance(content, dict):
        raise InputError(f"{path} cannot be read: run the experiment again to write it anew.")
    return content


def _planned(folder: Path, manifest: dict[str, Any]) -> list[dict[str, Any]]:
    try:
        suite = paper_suite(**manifest["configuration"])
    except (KeyError, TypeError):
        raise InputError(
            f"{folder / 'manifest.json'} does not say what was run: give a folder of results."
        ) from None
    return [trial.canonical() for trial in suite]


def _records(folder: Path) -> dict[str, dict[str, Any]]:
    """Finished trials by what they are; damaged files count as missing."""
    store = Store(folder)
    found = (store.get(path.stem) for path in sorted((folder / "trials").glob("*.json")))
    return {_key(record["trial"]): record for record in found if record is not None}


def _failures(folder: Path) -> dict[str, str]:
    """Reasons of failed trials by what they are."""
    reasons = {}
    for path in sorted((folder / "failed").glob("*.json")):
        try:
            failure = json.loads(path.read_text(encoding="utf-8"))
            reasons[_key(failure["trial"])] = str(failure["reason"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return reasons


def _key(trial: dict[str, Any]) -> str:
    return json.dumps(trial, sort_keys=True)
