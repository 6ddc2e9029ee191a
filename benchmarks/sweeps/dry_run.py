"""What a sweep would run, and about how long it would take."""

import time
from collections.abc import Sequence
from dataclasses import replace

from tabulate import tabulate

from benchmarks.execution.apart import provenance
from benchmarks.execution.driver import outcomes
from benchmarks.execution.engines import Engine, available_cpus
from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.running import Options
from benchmarks.trials.attempt import Outcome
from benchmarks.trials.provenance import Provenance
from benchmarks.trials.spec import Trial

BUDGET = 20.0  # seconds spent on measuring
_SHOWN = 60  # cells
_USUAL = 1000  # particles, where none are named


def dry_run(sweep: Sweep, options: Options) -> str:
    """Return the cells (setting and method) of a sweep with the time of a trial in each."""
    cells: dict[str, list[Trial]] = {}
    trials = sweep.distinct()
    for trial in trials:
        cells.setdefault(trial.cell(), []).append(trial)
    here = replace(options.where, executor="process", scheduler=None, jobs=1)
    with here.engine(trials) as engine:
        seconds = _measured(list(cells.values()), engine, provenance(sweep.cells()))
    rows = [
        [name, len(own), "failed" if s is None else f"{s:.2f} s" if measured else f"≈ {s:.2f} s"]
        for (name, own), (s, measured) in zip(cells.items(), seconds, strict=True)
    ]
    total = sum((s or 0.0) * len(own) for own, (s, _) in zip(cells.values(), seconds, strict=True))
    share = 1 if options.shard is None else options.shard[1]
    jobs = min(options.where.jobs or available_cpus(), len(trials))
    count = sum(measured for _, measured in seconds)
    lines = [f"{sweep.title}: {len(trials):,} trials in {len(cells):,} cells"]
    if equal := sweep.combinations - len(trials):
        lines.append(f"{equal:,} combinations equal others and are run once")
    lines.append(tabulate(rows[:_SHOWN], ["cell", "trials", "one trial"], disable_numparse=True))
    if len(rows) > _SHOWN:
        lines.append(f"… and {len(rows) - _SHOWN:,} more cells")
    part = "" if share == 1 else f" for this shard of {share}"
    working = f"{jobs} job{'' if jobs == 1 else 's'}"
    lines.append(
        f"About {_duration(total / jobs / share)} with {working}{part}: estimated from "
        f"one measured trial in {count} of {len(cells):,} cells; ≈ is by the localizer's mean "
        "time per particle. Nothing was written."
    )
    return "\n\n".join(lines)


def _measured(
    cells: Sequence[Sequence[Trial]], engine: Engine, made: Provenance
) -> list[tuple[float | None, bool]]:
    """Return for each cell the seconds of a trial (None: it failed) and whether it was measured.

    Every form of a localizer is measured in at least one cell; in others its time is taken to be
    that per particle.
    """
    began = time.perf_counter()
    _outcome(cells[0][0], engine, made)  # compile first
    known: dict[int, float | None] = {}
    rates: dict[tuple[str, Changes], list[float]] = {}  # seconds per particle
    first = {_form(cell[0]): index for index, cell in reversed([*enumerate(cells)])}
    for index in sorted(range(len(cells)), key=lambda i: i not in first.values()):
        trial = cells[index][0]
        if time.perf_counter() - began > BUDGET and _form(trial) in rates:
            continue
        started = time.perf_counter()
        outcome = _outcome(trial, engine, made)
        took = time.perf_counter() - started
        known[index] = None if outcome.record is None else took
        rate = took / _particles(trial)
        rates.setdefault(_form(trial), []).extend([rate] if outcome.record else [])
    return [
        (known[i], True) if i in known else (_scaled(rates[_form(cell[0])], cell[0]), False)
        for i, cell in enumerate(cells)
    ]


def _outcome(trial: Trial, engine: Engine, made: Provenance) -> Outcome:
    ((_, outcome),) = outcomes([(made.key(trial), trial)], engine)
    return outcome


def _scaled(rates: Sequence[float], trial: Trial) -> float | None:
    return sum(rates) / len(rates) * _particles(trial) if rates else None


def _form(trial: Trial) -> tuple[str, Changes]:
    return trial.localizer, trial.params | {"particles": _USUAL}


def _particles(trial: Trial) -> int:
    return int(trial.params.get("particles", _USUAL))


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
