"""How far a sweep has come: what a store holds of it, and the same in words."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.setup import documents
from benchmarks.sweeps import manifest
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.manifest import Manifest
from benchmarks.sweeps.results import Failure, Results
from benchmarks.sweeps.store import Store, named
from benchmarks.sweeps.sweepfile import sweep_of
from benchmarks.tables.gap import LimitRuns
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError

_SHOWN = 20  # lines of a kind


def collected(sweep: Sweep, trials: Mapping[str, Trial], store: Store, made: Manifest) -> Results:
    """Return what the store has of these trials (by key), in their order."""
    records, failures = [], []
    for key, trial in trials.items():
        if (finished := store.get(key, trial)) is not None:
            records.append(finished)
        elif (reason := store.failure(key, trial)) is not None:
            failures.append(Failure(trial=trial.canonical(), reason=reason))
    asked = {named(trial.canonical()) for trial in trials.values()}
    results = Results(
        title=sweep.title,
        records=records,
        failures=failures,
        missing=len(trials) - len(records) - len(failures),
        planned=len(trials),
        command=list(made.command),
        environment=made.environment,
        verified=[one.words() for one in made.verified],
        left_out=store.rejected | dict(store.left_out(trials.keys(), asked)),
    )
    return of_sweep(sweep, results)


def of_sweep(sweep: Sweep, results: Results) -> Results:
    """Return the results with the trials of limits set apart, and with the sweep's baseline."""
    by_name = [(named(record["trial"]), record) for record in results.records]

    def finished(trials: Iterable[Trial]) -> list[dict[str, Any]]:
        asked = {named(trial.canonical()) for trial in trials}
        return [record for name, record in by_name if name in asked]

    return replace(
        results,
        records=finished(sweep.compared()),
        limits=[LimitRuns(limit.of, finished(sweep.limiting(limit))) for limit in sweep.limits],
        baseline=sweep.baseline,
    )


def results_in(folder: Path) -> Results:
    """Return what a folder holds of its own sweep; nothing that it names is loaded or run.

    Its trials are those that the code, libraries and plug-ins of its manifest have made, whatever
    is installed here.

    Raises:
        InputError: the folder is not one of results, or none of its files can be read.
    """
    made = manifest.read(folder)
    sweep = recorded_sweep(folder, made)
    trials = {made.made.key(trial): trial for trial in sweep.distinct()}
    results = collected(sweep, trials, Store(folder, reading=True), made)
    if results.left_out and results.missing == results.planned:
        name, why = next(iter(results.left_out.items()))
        raise InputError(
            f"{folder} has no trial of its sweep, but {len(results.left_out)} others ({name} {why})"
            ": give another folder, or run the sweep again."
        )
    return results


def recorded_sweep(folder: Path, made: Manifest) -> Sweep:
    """Return the sweep of a folder's manifest; nothing that it names is loaded.

    Raises:
        InputError: the manifest was changed.
    """
    with documents.errors_name(folder / manifest.NAME):
        return sweep_of(made.sweep, title="", takes=partial(_recorded, made.parameters))


def _recorded(parameters: Mapping[str, Sequence[str] | None], name: str) -> tuple[str, ...] | None:
    if name not in parameters:
        raise InputError(f"parameters has no {name!r}: the manifest was changed.")
    known = parameters[name]
    return None if known is None else tuple(known)


def left_out_lines(results: Results, out: Path) -> list[str]:
    """Say which files of a folder are in no table, and why."""
    lines = [
        f"deqmcl: {out / name} {why}; it is left out." for name, why in results.left_out.items()
    ]
    more = [f"deqmcl: … and {len(lines) - _SHOWN:,} more files are left out."]
    return lines if len(lines) <= _SHOWN else lines[:_SHOWN] + more


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
    there = {named(record["trial"]) for record in results.finished}
    planned: Counter[str] = Counter()
    done: Counter[str] = Counter()
    for trial in sweep.distinct():
        planned[trial.cell()] += 1
        done[trial.cell()] += named(trial.canonical()) in there
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
