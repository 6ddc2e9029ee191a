"""Results that survive a change of code: a sample is run again, and its records are compared.

Equal to the last digit, or not taken over. A sample cannot prove what happens rarely.
"""

import contextlib
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.execution.engines import Where, outcomes
from benchmarks.sweeps import manifest
from benchmarks.sweeps.manifest import Verified, differences
from benchmarks.sweeps.results import recorded_sweep
from benchmarks.sweeps.running import counted
from benchmarks.sweeps.store import Store
from benchmarks.trials.attempt import Outcome, provenance_of
from benchmarks.trials.provenance import Provenance, environment
from benchmarks.trials.scoring import SCORE_NAMES, Finished, TrialRecord
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError

SAMPLED = 0.01  # of the trials beside the first of each setting and method


class DifferentError(RuntimeError):
    """Trials have other results than before."""

    exit_code = 1


def verify(folder: Path, where: Where, share: float = SAMPLED) -> str:
    """Run a sample of a folder's finished trials again; if all agree, its manifest says so."""
    made = manifest.read_manifest(folder)
    sweep, store = recorded_sweep(folder, made), Store(folder)
    now = provenance_of(sweep.cells())
    trials = {made.identity.key(trial): trial for trial in sweep.distinct()}
    records = {key: record for key, trial in trials.items() if (record := store.get(key, trial))}
    if not records:
        raise InputError(f"{folder} has no finished trial: there is nothing to verify.")
    chosen = sample({key: trials[key] for key in records}, now.code, share)
    differing = compare_again(
        chosen, now, where, lambda key, found: _difference(records[key], found), folder
    )
    if differing:
        raise DifferentError(_sentence(folder, chosen, differing))
    parts = now.code, now.libraries, now.plug_ins
    checked = Verified(*parts, keys=list(chosen), of=len(records), environment=environment())
    known: list[Provenance] = [made.identity, *made.verified]
    if parts not in [(one.code, one.libraries, one.plug_ins) for one in known]:
        manifest.append(folder, checked)
    return f"{folder}: {checked.words()}; none differs. A sample cannot prove what happens rarely."


def _sentence(folder: Path, chosen: Mapping[str, Trial], differing: Mapping[str, str]) -> str:
    """Say how many trials differ, and how the first one does."""
    key = next(key for key in chosen if key in differing)
    trial = chosen[key]
    return (
        f"{folder}: {len(differing)} of {len(chosen)} trials differ from those before; the first "
        f"is {' '.join(trial.words())}, world {trial.trial}, filter seed {trial.filter_seed}: "
        f"{differing[key]}. Give a new --out."
    )


def compare_again(
    trials: Mapping[str, Trial],
    now: Provenance,
    where: Where,
    difference: Callable[[str, Outcome], str | None],
    folder: Path | None = None,
) -> dict[str, str]:
    """Run trials (by name) again; return how those differ that do, as ``difference`` says."""
    names = {now.key(trial): name for name, trial in trials.items()}
    differing: dict[str, str] = {}
    with (
        where.engine(trials.values()) as engine,
        counted(folder or Path(), len(trials), len(trials), shown=folder is not None) as count,
        contextlib.closing(outcomes([(k, trials[names[k]]) for k in names], engine)) as ended,
    ):
        for key, outcome in ended:
            if why := difference(names[key], outcome):
                differing[names[key]] = why
            count(bool(why))
    return differing


def sample(trials: Mapping[str, Trial], code: str, share: float = SAMPLED) -> dict[str, Trial]:
    """Return the first trial of each setting and method, and a share of the others: 1 %.

    Nobody picks those: they are drawn by the digest of the code that is to be verified.
    """
    first: dict[str, str] = {}
    for key, trial in trials.items():
        first.setdefault(json.dumps(trial.canonical() | {"trial": 0, "filter_seed": 0}), key)
    others = sorted(
        trials.keys() - first.values(),
        key=lambda key: hashlib.sha256(f"{code} {key}".encode()).digest(),
    )
    count = math.ceil(round(share * len(others), 6))  # 0.07 * 100 is above 7
    chosen = {*first.values(), *others[:count]}
    return {key: trial for key, trial in trials.items() if key in chosen}


def _difference(before: Finished, now: Outcome) -> str | None:
    """Say where a trial's record differs first, its scores before all else; times may differ."""
    if now.record is None:
        return f"it finished before and fails now: {now.reason}"
    return next(differences(record_parts(before), record_parts(now.record)), None)


def record_parts(record: TrialRecord) -> dict[str, Any]:
    """Return all that is in a record by name, its scores first; no times."""
    scores = {
        f"{name} at offset {row['offset']}": row[name]
        for row in record.scores
        for name in SCORE_NAMES
    }
    parts = {
        name: getattr(record, name) for name in TrialRecord.__struct_fields__ if name != "scores"
    }
    others: dict[str, Any] = msgspec.to_builtins(parts, str_keys=True)
    return scores | others
