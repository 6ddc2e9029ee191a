"""Results that survive a change of code: a sample is run again, and its records are compared.

Equal to the last digit, or not taken over. A sample cannot prove what happens rarely.
"""

import contextlib
import hashlib
import json
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.execution.apart import provenance
from benchmarks.execution.engines import Where, outcomes
from benchmarks.files import locked
from benchmarks.sweeps import manifest
from benchmarks.sweeps.manifest import Manifest, Verified, differences
from benchmarks.sweeps.results import recorded_sweep
from benchmarks.sweeps.running import counted
from benchmarks.sweeps.store import Store
from benchmarks.trials.attempt import Outcome
from benchmarks.trials.provenance import environment
from benchmarks.trials.scoring import LATER, SCORE_NAMES, Finished, Record
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError

_SHARE = 100  # one of so many trials, beside the first of each setting and method


class DifferentError(RuntimeError):
    """Trials have other results than before."""

    exit_code = 1


def verify(folder: Path, where: Where) -> str:
    """Run a sample of a folder's finished trials again; if all agree, its manifest says so.

    Args:
        folder: of a sweep; nothing in it changes unless all agree.
        where: the engine.

    Returns:
        What was found, in a sentence.

    Raises:
        InputError: it is no folder of results, has no finished trial, or is in use.
        DifferentError: the first trial that differs, and its first score.
    """
    made = manifest.read(folder)
    with locked(folder):
        sweep, store = recorded_sweep(folder, made), Store(folder, reading=True)
        now = provenance(sweep.cells())
        trials = {made.made.key(trial): trial for trial in sweep.distinct()}
        records = {
            key: record for key, trial in trials.items() if (record := store.get(key, trial))
        }
        if not records:
            raise InputError(f"{folder} has no finished trial: there is nothing to verify.")
        chosen = sample({key: trials[key] for key in records}, now.code)
        keys = {now.key(trial): key for key, trial in chosen.items()}
        differing: dict[str, str] = {}
        with (
            where.engine(chosen.values()) as engine,
            counted(folder, len(chosen), len(chosen)) as count,
            contextlib.closing(outcomes([(k, chosen[keys[k]]) for k in keys], engine)) as finished,
        ):
            for own, outcome in finished:
                if why := _difference(records[keys[own]], outcome):
                    differing[keys[own]] = why
                count(bool(why))
        if differing:
            raise DifferentError(_sentence(folder, chosen, differing))
        parts = now.code, now.libraries, now.plug_ins
        checked = Verified(*parts, keys=list(chosen), of=len(records), environment=environment())
        known = [made.made, *made.verified]
        if parts not in [(one.code, one.libraries, one.plug_ins) for one in known]:
            manifest.append(folder, checked)
    return f"{folder}: {checked.words()}; none differs. A sample cannot prove what happens rarely."


def adopt(folder: Path, ours: Manifest, where: Where) -> str:
    """Verify a folder of our sweep that is of other code; return what was found, if it is one."""
    return verify(folder, where) if manifest.is_of_other_code(folder, ours) else ""


def sample(trials: Mapping[str, Trial], code: str) -> dict[str, Trial]:
    """Return the first trial of each setting and method, and 1 % of the others.

    Nobody picks those: they are drawn by the digest of the code that is to be verified.
    """
    first: dict[str, str] = {}
    for key, trial in trials.items():
        first.setdefault(json.dumps(trial.canonical() | {"trial": 0, "filter_seed": 0}), key)
    others = sorted(
        trials.keys() - first.values(),
        key=lambda key: hashlib.sha256(f"{code} {key}".encode()).digest(),
    )
    chosen = {*first.values(), *others[: math.ceil(len(others) / _SHARE)]}
    return {key: trial for key, trial in trials.items() if key in chosen}


def fingerprint(record: Record) -> str:
    """Return a digest of all that is in a record, times left out: equal only if it is.

    Parts that a record does not have are left out, so that new ones change no other digest.
    """
    there = {name: part for name, part in _by_score(record).items() if part is not None}
    plain = msgspec.to_builtins(there, str_keys=True, enc_hook=float)
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:32]


def _difference(before: Finished, now: Outcome) -> str | None:
    """Say where a trial's record differs first, its scores before all else; times may differ."""
    if now.record is None:
        return f"it finished before and fails now: {now.reason}"
    lacking = {name for row in before.scores for name in LATER - row.keys()}
    return next(differences(_by_score(before), _by_score(now.record, lacking)), None)


def _by_score(record: Record, without: Collection[str] = ()) -> dict[str, Any]:
    scores = {
        f"{name} at offset {row['offset']}": row[name]
        for row in record.scores
        for name in SCORE_NAMES
        if name in row and name not in without
    }
    parts = {name: getattr(record, name) for name in Record.__struct_fields__ if name != "scores"}
    others: dict[str, Any] = msgspec.to_builtins(parts, str_keys=True)
    return scores | others


def _sentence(folder: Path, chosen: Mapping[str, Trial], differing: Mapping[str, str]) -> str:
    key = next(key for key in chosen if key in differing)
    trial = chosen[key]
    return (
        f"{folder}: {len(differing)} of {len(chosen)} trials differ from those before; the first "
        f"is {' '.join(trial.words())}, world {trial.trial}, filter seed {trial.filter_seed}: "
        f"{differing[key]}. Give a new --out."
    )
