"""Run sweeps: only what is missing, anywhere, each trial stored when it is done; dry runs.

And results that survive a change of code: a sample is run again, and its records are compared.
Equal to the last digit, or not taken over. A sample cannot prove what happens rarely.
"""

import contextlib
import hashlib
import io
import json
import math
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from tabulate import tabulate
from tqdm.auto import tqdm

from benchmarks.console import FailedWarning, beside, doing, say
from benchmarks.execution.engines import Engine, Where, available_cpus, outcomes
from benchmarks.sweeps import Sweep, by_cell, manifest
from benchmarks.sweeps.manifest import Manifest, Verified, differences
from benchmarks.sweeps.results import (
    Results,
    collected,
    due,
    incomplete_sentence,
    left_out_lines,
    recorded_sweep,
    rule_of,
)
from benchmarks.sweeps.store import Store, writing
from benchmarks.tables.panels import trial_words
from benchmarks.trials import Provenance, Trial, environment
from benchmarks.trials.scoring import SCORE_NAMES, TrialRecord
from benchmarks.trials.stage import Outcome, check_trials, provenance_of
from deqmcl_gym.validation import InputError, amount, one_line, shown

MINUTE = 60.0  # s between two lines about the progress, where there is no terminal
_LINE = "{desc}: {n_fmt} of {total_fmt} done after {elapsed}, {remaining} left{postfix}"


class TrialsFailedError(RuntimeError):
    """Some trials failed; the others are stored."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How a sweep is run; no result depends on it. Shard (i, n): each n-th trial, from the i-th."""

    where: Where = field(default_factory=Where)
    shard: tuple[int, int] | None = None
    retry_failed: bool = False
    progress: bool = True


@dataclass(frozen=True)
class Running:
    """A sweep in its folder, to which nobody else writes meanwhile."""

    sweep: Sweep
    store: Store
    trials: dict[str, Trial]  # by key
    options: Options
    made: Manifest
    now: Provenance

    def results(self) -> Results:
        """Run the trials that are missing; return what is there then, and warn if some failed."""
        number, of = self.options.shard or (1, 1)
        part = {key: self.trials[key] for key in list(self.trials)[number - 1 :: of]}
        asked: dict[str, Trial] = {}
        while new := self._due(part, asked):  # once, or up to the next look of whatever is open
            run_missing(new, self.store, self.options, self.now)
            asked |= new
        results = collected(self.sweep, self.trials, self.store, self.made)
        for line in left_out_lines(results, self.store.out):
            print(line, file=sys.stderr)
        if results.failures:
            warnings.warn(incomplete_sentence(results), FailedWarning, stacklevel=2)
        return results

    def _due(self, part: dict[str, Trial], asked: Mapping[str, Trial]) -> dict[str, Trial]:
        """Return the trials that are needed after those that were asked for."""
        records = (self.store.get(key, trial) for key, trial in asked.items())
        failures = (trial for key, trial in asked.items() if self.store.failure(key) is not None)
        needed = due(self.sweep, part, filter(None, records), failures)
        return {key: trial for key, trial in needed.items() if key not in asked}


@contextmanager
def begun(
    sweep: Sweep, out: Path | str, options: Options, command: Sequence[str]
) -> Iterator[Running]:
    """Open the folder of a sweep at which ``check`` has looked; nothing is run yet."""
    out = Path(out)
    ours = manifest.manifest_of(sweep, command)
    manifest.taken_over(out, ours)
    with writing(out, options.shard) as store:
        made = manifest.begin(out, ours)
        trials = {made.identity.key(trial): trial for trial in sweep.distinct()}
        yield Running(sweep, store, trials, options, made, ours.identity)


def check(sweep: Sweep) -> None:
    """Build every world and every localizer of a sweep once, before anything is written."""
    rule_of(sweep)
    check_trials(sweep.cells())


def run_missing(trials: dict[str, Trial], store: Store, options: Options, now: Provenance) -> None:
    """Run the trials (by key) that the store lacks, and store what comes of them.

    All methods run on one world before any runs on the next, as an episode may be driven once for
    all of them. ``now`` is what workers must have loaded: keys may be of code before it.
    """
    missing = {
        key: trial
        for key, trial in trials.items()
        if store.get(key, trial) is None and (options.retry_failed or store.failure(key) is None)
    }
    if not missing:
        return
    keys = {now.key(trial): key for key, trial in missing.items()}
    waiting = [(current, missing[key]) for current, key in keys.items()]
    first = {trial.episode: index for index, (_, trial) in reversed([*enumerate(waiting)])}
    waiting.sort(key=lambda item: (item[1].trial, first[item[1].episode], item[1].filter_seed))
    with (
        options.where.engine(missing.values()) as engine,
        counted(store.out, len(trials), len(waiting), shown=options.progress) as count,
        contextlib.closing(outcomes(waiting, engine)) as finished,
    ):
        for current, outcome in finished:
            reason = _keep(store, keys[current], missing[keys[current]], outcome)
            count(reason is not None)


@contextmanager
def counted(
    out: Path, total: int, waiting: int, *, shown: bool = True
) -> Iterator[Callable[[bool], None]]:
    """Show a bar on a terminal, elsewhere a line a minute; yield ``count(failure)`` of a trial."""
    name, failed = one_line(out.resolve().name), 0
    lines = shown and "ipykernel" not in sys.modules and not sys.stderr.isatty()
    how: dict[str, Any] = {"desc": name, "total": total, "initial": total - waiting}
    if lines:  # what tqdm would print goes nowhere; it counts and estimates
        how |= {"file": io.StringIO(), "mininterval": math.inf, "bar_format": _LINE}
        how |= {"smoothing": 0.0}
    with tqdm(**how, unit="trial", disable=not shown) as bar:

        def count(failure: bool) -> None:
            nonlocal failed
            failed += failure
            bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
            bar.update()

        def tell(done: threading.Event) -> None:
            while not done.wait(MINUTE):
                print(f"deqmcl: {bar}", file=sys.stderr, flush=True)

        if lines:
            running = f"{name}: running {amount(waiting, 'trial')}"
            with doing(running), beside(tell):
                yield count
        else:
            bar.set_postfix_str("starting; kernels are compiled at first use")
            yield count


def complete(results: Results, text: str, *, part: bool = False) -> str:
    """Return what a command prints at its end; print it and raise if any failed or is missing."""
    lacking = incomplete_sentence(results)
    if lacking and (results.failures or not part):
        say(text)
        raise TrialsFailedError(lacking)
    return text


def _keep(store: Store, key: str, trial: Trial, outcome: Outcome) -> str | None:
    """Store what came of a trial; return why it failed, None if it did not."""
    reason = outcome.reason or "no reason was given"
    try:
        if outcome.record is not None:
            store.put(key, trial, outcome.record, outcome.seconds)
            return None
    except ValueError as error:
        reason = f"its record cannot be kept: {error}"
    store.put_failure(key, trial, reason)
    return reason


def shard_of(text: str) -> tuple[int, int]:
    """Return (i, n) of "i/n"."""
    if match := re.fullmatch(r"(\d{1,6})/(\d{1,6})", text):
        number, of = map(int, match.groups())
        if 1 <= number <= of <= 100_000:
            return number, of
    raise InputError(f"--shard is {shown(text)}, but must be i/n with i from 1 to n, like 2/8.")


_CELLS_SHOWN = 60


def dry_run(sweep: Sweep, jobs: int | None = None, timeout: float | None = None) -> str:
    """Return the cells of a sweep with the time of a trial in each, and the time of it all."""
    trials = sweep.distinct()
    cells = by_cell(trials)
    firsts = [group[0] for group in cells.values()]
    with Where(jobs=1, timeout=timeout).engine(firsts) as engine:
        seconds = _seconds(firsts, engine, provenance_of(firsts))
    names = [*map(trial_words, firsts)]
    alike = [part for part in names[0] if len(names) > 1 and all(part in name for name in names)]
    rows, total = [], 0.0
    for name, group, duration in zip(names, cells.values(), seconds, strict=True):
        rest = " ".join(part for part in name if part not in alike)
        rows.append((len(group), "failed" if duration is None else f"≈ {duration:.2f} s", rest))
        total += (duration or 0.0) * len(group)
    jobs = min(jobs or available_cpus(), len(trials))
    most = "" if sweep.until_decided is None else "at most "
    lines = [f"{sweep.title}: {most}{len(trials):,} trials in {len(cells):,} cells"]
    if equal := sweep.combinations - len(trials):
        lines.append(f"{equal:,} combinations equal others and are run once")
    if alike:
        lines.append(f"in all cells: {' '.join(alike)}")
    header = ["trials", "one trial", "cell"]
    lines.append(tabulate(rows[:_CELLS_SHOWN], header, disable_numparse=True))
    if len(rows) > _CELLS_SHOWN:
        lines.append(f"… and {len(rows) - _CELLS_SHOWN:,} more cells")
    s = total / jobs
    needed = f"{s:.0f} s" if s < 90 else f"{s / 60:.0f} min" if s < 5400 else f"{s / 3600:.1f} h"
    lines.append(
        f"{'At most about' if most else 'About'} {needed} with {amount(jobs, 'job')}: "
        "estimated from one measured trial of each localizer in each scenario, by its time per "
        "particle. Nothing was written."
    )
    return "\n\n".join(lines)


def _seconds(trials: Sequence[Trial], engine: Engine, made: Provenance) -> list[float | None]:
    """Return the seconds of each trial, by those of the first that is alike; None: that fails."""
    particles = {trial: int(trial.params.get("particles", 1000)) for trial in trials}
    first = {(trial.scenario, trial.localizer): trial for trial in reversed(trials)}
    seconds: dict[tuple[str, str], float | None] = {}  # of one particle
    for trial in (trials[0], *first.values()):  # the first one compiles
        started = time.perf_counter()
        ((_, outcome),) = outcomes([(made.key(trial), trial)], engine)
        took = (time.perf_counter() - started) / particles[trial]
        seconds[trial.scenario, trial.localizer] = None if outcome.record is None else took
    each = ((seconds[trial.scenario, trial.localizer], n) for trial, n in particles.items())
    return [None if rate is None else rate * n for rate, n in each]


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

    def difference(key: str, outcome: Outcome) -> str | None:
        if outcome.record is None:
            return f"it finished before and fails now: {outcome.reason}"
        parts = record_parts(records[key]), record_parts(outcome.record)
        return next(differences(*parts), None)  # times may differ

    if differing := compare_again(chosen, now, where, difference, folder):
        key = next(key for key in chosen if key in differing)
        trial = chosen[key]
        raise DifferentError(
            f"{folder}: {len(differing)} of {len(chosen)} trials differ from those before; the "
            f"first is {' '.join(trial_words(trial))}, world {trial.trial}, filter seed "
            f"{trial.filter_seed}: {differing[key]}. Give a new --out."
        )
    parts = now.code, now.libraries, now.plug_ins
    checked = Verified(*parts, keys=list(chosen), of=len(records), environment=environment())
    earlier: list[Provenance] = [made.identity, *made.verified]
    if parts not in [(p.code, p.libraries, p.plug_ins) for p in earlier]:
        manifest.append(folder, checked)
    return f"{folder}: {checked.words()}; none differs. A sample cannot prove what happens rarely."


def compare_again(
    trials: Mapping[str, Trial],
    now: Provenance,
    where: Where,
    difference: Callable[[str, Outcome], str | None],
    folder: Path | None = None,
) -> dict[str, str]:
    """Run trials (by name) again; return the ``difference`` of each that has one."""
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


def record_parts(record: TrialRecord) -> dict[str, Any]:
    """Return all that is in a record by name, its scores first; no times."""
    rows = {row["offset"]: row for row in record.scores}
    scores = {f"{n} at offset {k}": row[n] for k, row in rows.items() for n in SCORE_NAMES}
    parts = {n: getattr(record, n) for n in TrialRecord.__struct_fields__ if n != "scores"}
    others: dict[str, Any] = msgspec.to_builtins(parts, str_keys=True)
    return scores | others
