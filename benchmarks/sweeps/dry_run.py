"""What a sweep would run, and about how long it would take."""

import time
from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean

from tabulate import tabulate

from benchmarks.execution.engines import Where, available_cpus, outcomes
from benchmarks.execution.executors import Engine
from benchmarks.setup.overrides import Overrides
from benchmarks.sweeps.design import Sweep, cells_of
from benchmarks.trials.plugins import provenance_of
from benchmarks.trials.provenance import Provenance
from benchmarks.trials.spec import Trial

BUDGET = 20.0  # seconds spent on measuring
_SHOWN = 60  # cells
_USUAL = 1000  # particles, where none are named


def dry_run(
    sweep: Sweep, jobs: int | None = None, timeout: float | None = None, shards: int = 1
) -> str:
    """Return the cells (setting and method) of a sweep with the time of a trial in each.

    The whole is told for so many ``jobs``, and for one of so many ``shards``.
    """
    trials = sweep.distinct()
    cells = cells_of(trials)
    asked = Where(jobs=jobs, timeout=timeout)
    with replace(asked, jobs=1).engine(trials) as engine:
        times = _times([own[0] for own in cells.values()], engine, provenance_of(sweep.cells()))
    words = [own[0].words() for own in cells.values()]
    alike = [part for part in words[0] if len(words) > 1 and all(part in own for own in words)]
    rows = [
        [
            len(own),
            "failed" if s is None else f"{s:.2f} s" if measured else f"≈ {s:.2f} s",
            " ".join(part for part in name if part not in alike),
        ]
        for name, own, (s, measured) in zip(words, cells.values(), times, strict=True)
    ]
    total = sum((s or 0.0) * len(own) for own, (s, _) in zip(cells.values(), times, strict=True))
    jobs = min(jobs or available_cpus(), len(trials))
    count = sum(measured for _, measured in times)
    most = "at most " if sweep.until_decided else ""
    lines = [f"{sweep.title}: {most}{len(trials):,} trials in {len(cells):,} cells"]
    if equal := sweep.combinations - len(trials):
        lines.append(f"{equal:,} combinations equal others and are run once")
    if alike:
        lines.append(f"in all cells: {' '.join(alike)}")
    lines.append(tabulate(rows[:_SHOWN], ["trials", "one trial", "cell"], disable_numparse=True))
    if len(rows) > _SHOWN:
        lines.append(f"… and {len(rows) - _SHOWN:,} more cells")
    part = "" if shards == 1 else f" for this shard of {shards}"
    s = total / jobs / shards
    needed = f"{s:.0f} s" if s < 90 else f"{s / 60:.0f} min" if s < 5400 else f"{s / 3600:.1f} h"
    working = f"{jobs} job{'' if jobs == 1 else 's'}"
    lines.append(
        f"{'At most about' if most else 'About'} {needed} with {working}{part}: estimated from "
        f"one measured trial in {count} of {len(cells):,} cells; ≈ is by the localizer's mean "
        "time per particle. Nothing was written."
    )
    return "\n\n".join(lines)


def _times(
    trials: Sequence[Trial], engine: Engine, made: Provenance
) -> list[tuple[float | None, bool]]:
    """Return the seconds that each trial takes (None: it fails) and whether they were measured.

    Every form of a localizer is measured at least once; the times of others are taken to be those
    per particle.
    """

    def measured(trial: Trial) -> float | None:
        started = time.perf_counter()
        ((_, outcome),) = outcomes([(made.key(trial), trial)], engine)
        return None if outcome.record is None else time.perf_counter() - started

    began = time.perf_counter()
    measured(trials[0])  # compile first
    known: dict[int, float | None] = {}
    rates: dict[tuple[str, Overrides], list[float]] = {}  # seconds per particle
    first = {_form(trial): index for index, trial in reversed([*enumerate(trials)])}
    for index in sorted(range(len(trials)), key=lambda i: i not in first.values()):
        trial = trials[index]
        own = rates.setdefault(_form(trial), [])
        if index in first.values() or time.perf_counter() - began < BUDGET:
            known[index] = took = measured(trial)
            own += [] if took is None else [took / _particles(trial)]

    def scaled(trial: Trial) -> float | None:
        own = rates[_form(trial)]
        return fmean(own) * _particles(trial) if own else None

    return [
        (known[index], True) if index in known else (scaled(trial), False)
        for index, trial in enumerate(trials)
    ]


def _form(trial: Trial) -> tuple[str, Overrides]:
    return trial.localizer, trial.params | {"particles": _USUAL}


def _particles(trial: Trial) -> int:
    return int(trial.params.get("particles", _USUAL))
