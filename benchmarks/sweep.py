"""Run trials: those that are missing, on one or many processes, each stored when it is done."""

import multiprocessing
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.episode import room_of, trial_moments
from benchmarks.provenance import provenance
from benchmarks.scoring import record
from benchmarks.spec import Trial
from benchmarks.store import Store
from benchmarks.trace import Trace, trace_of


class TrialsFailedError(RuntimeError):
    """Some trials raised; the others are stored."""


def run_trials(
    trials: Sequence[Trial], store: Store, *, jobs: int, progress: bool = True
) -> list[dict[str, Any]]:
    """Return the record of every trial, in the given order; run those the store lacks.

    A record depends on its trial alone: not on ``jobs``, nor on the order, nor on what was
    resumed. A failing trial does not stop the others.

    Raises:
        TrialsFailedError: with each failed trial and its reason; the finished ones are kept.
    """
    keys = [trial.key(provenance()) for trial in trials]
    missing = [trial for trial, key in zip(trials, keys, strict=True) if store.get(key) is None]
    reasons = []
    with tqdm(
        total=len(trials),
        initial=len(trials) - len(missing),
        unit="trial",
        disable=None if progress else True,
    ) as bar:
        for reason in _run_all(missing, store.out, jobs):
            bar.update()
            if reason is not None:
                reasons.append(reason)
    if reasons:
        raise TrialsFailedError(
            f"{len(reasons)} of {len(trials)} trials failed, the rest is kept; "
            f"first: {sorted(reasons)[0]}"
        )
    records = [found for key in keys if (found := store.get(key)) is not None]
    if len(records) < len(keys):
        raise TrialsFailedError(
            f"{len(keys) - len(records)} of {len(keys)} finished trials have gone from "
            f"{store.out}, or cannot be read: run the command again."
        )
    return records


def available_cpus() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def trial_trace(trial: Trial) -> Trace:
    """Run one trial and return its trace."""
    return trace_of(trial_moments(trial), trial.offsets, room_of(trial.preset))


def _run_all(trials: Sequence[Trial], out: Path, jobs: int) -> Iterator[str | None]:
    """Run and store trials; yield None or a reason to have failed for each, as they finish."""
    workers = min(jobs, len(trials))
    if workers <= 1:
        yield from _run_here(trials, out)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        try:
            futures = [pool.submit(_run_and_store, trial, out, provenance()) for trial in trials]
            for future in as_completed(futures):
                yield future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _run_here(trials: Iterable[Trial], out: Path) -> Iterator[str | None]:
    for trial in trials:
        yield _run_and_store(trial, out, provenance())


def _run_and_store(trial: Trial, out: Path, code: str) -> str | None:
    """Run and store a trial; ``code`` is the provenance that the sweep was started with."""
    if provenance() != code:  # a worker loads the code when it starts
        return "the code changed while the trials ran: run the command again"
    try:
        trace = trial_trace(trial)
        result = {"trial": trial.canonical()} | record(trace, trial.lag)
    except Exception as error:
        return f"{trial.localizer}, trial {trial.trial}: {type(error).__name__}: {error}"
    Store(out).put(trial.key(provenance()), result, trace.seconds)
    return None
