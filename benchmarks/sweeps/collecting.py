"""How far a sweep has come: what a store holds of it, and the same in words."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.sweeps import manifest
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.results import Failure, Results
from benchmarks.sweeps.store import Store
from benchmarks.sweeps.sweepfile import sweep_of
from benchmarks.trials.provenance import environment
from benchmarks.trials.spec import Trial, unworded
from deqmcl_gym.validation import InputError

_SHOWN = 20  # cells that are not complete


def collected(
    title: str, trials: Mapping[str, Trial], store: Store, command: Sequence[str]
) -> Results:
    """Return what the store has of these trials (by key)."""
    planned = {key: trial.canonical() for key, trial in trials.items()}
    return _found(planned, store.get, store.failure, title, command, environment())


def _found(
    planned: Mapping[str, dict[str, Any]],
    record: Callable[[str], dict[str, Any] | None],
    failure: Callable[[str], dict[str, Any] | None],
    title: str,
    command: Sequence[str],
    environment: dict[str, Any],
) -> Results:
    """Return what is found of the trials that were planned, in their order."""
    records, failures = [], []
    for name, trial in planned.items():
        if (finished := record(name)) is not None:
            records.append(finished)
        elif (failed := failure(name)) is not None:
            failures.append(Failure(trial=trial, reason=failed["reason"]))
    return Results(
        title=title,
        records=records,
        failures=failures,
        missing=len(planned) - len(records) - len(failures),
        planned=len(planned),
        command=list(command),
        environment=environment,
    )


def of_sweep(sweep: Sweep, results: Results) -> Results:
    """Return the results with the trials of the limit set apart, and with the sweep's baseline."""
    compared = {_name(trial.canonical()) for trial in sweep.compared()}
    limits = {_name(trial.canonical()) for trial in sweep.limits()}
    return replace(
        results,
        records=[record for record in results.records if _name(record["trial"]) in compared],
        limits=[record for record in results.records if _name(record["trial"]) in limits],
        baseline=sweep.baseline,
    )


def results_in(folder: Path) -> Results:
    """Return what the folder of a sweep holds, whatever code has made it.

    Raises:
        InputError: the folder is not one of results, or none of its files can be read.
    """
    content = manifest.read(folder)
    try:
        sweep = sweep_of(unworded(content["identity"]["sweep"]), title="")
        command, environment = content["command"], content["environment"]
    except (KeyError, TypeError):
        raise InputError(
            f"{folder / manifest.NAME} does not say what was run: give a folder of results."
        ) from None
    store = Store(folder, reading=True)
    finished = {_name(r["trial"]): r for key in store.keys("trials") if (r := store.get(key))}
    failed = {_name(f["trial"]): f for key in store.keys("failed") if (f := store.failure(key))}
    if store.rejected and not finished and not failed:
        name, why = next(iter(store.rejected.items()))
        raise InputError(
            f"none of the {len(store.rejected)} trials in {folder} can be read ({name} {why}): "
            "run them again into a new --out."
        )
    planned = {_name(own): own for own in (trial.canonical() for trial in sweep.distinct())}
    results = _found(planned, finished.get, failed.get, sweep.title, command, environment)
    return of_sweep(sweep, results)


def summary(sweep: Sweep, results: Results, out: Path, files: Sequence[Path]) -> str:
    """Say how far a sweep has come, and where that is written."""
    done = results.planned - len(results.failures) - results.missing
    parts = [f"{sweep.title}: {done:,} of {results.planned:,} trials finished"]
    if results.failures:
        parts.append(f"{len(results.failures):,} failed")
    if results.missing:
        parts.append(f"{results.missing:,} missing")
    lines = [", ".join(parts) + "."]
    lines += _incomplete(sweep, results)
    if equal := sweep.combinations - results.planned:
        lines.append(f"{equal:,} combinations equal others and were run once.")
    names = ", ".join(path.name for path in files if path.parent == out)
    return "\n".join([*lines, f"Written to {out}: {names}."])


def _incomplete(sweep: Sweep, results: Results) -> list[str]:
    """Say of each setting and method how many of its trials are there, unless all are."""
    if not results.failures and not results.missing:
        return []
    there = {_name(record["trial"]) for record in results.finished}
    planned: Counter[str] = Counter()
    done: Counter[str] = Counter()
    for trial in sweep.distinct():
        planned[trial.cell()] += 1
        done[trial.cell()] += _name(trial.canonical()) in there
    lines = [f"  {done[cell]} of {n}: {cell}" for cell, n in planned.items() if done[cell] < n]
    more = [f"  … and {len(lines) - _SHOWN} more"] if len(lines) > _SHOWN else []
    return ["Not complete:", *lines[:_SHOWN], *more]


def failed_sentence(results: Results) -> str:
    """Say how many trials failed, and the first reason."""
    first = results.failures[0]
    return (
        f"{len(results.failures)} of {results.planned} trials failed, the rest is kept; first: "
        f"{first.trial['localizer']}, trial {first.trial['trial']}: {first.reason}"
    )


def _name(trial: Mapping[str, Any]) -> str:
    return json.dumps(trial, sort_keys=True)
