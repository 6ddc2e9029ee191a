"""``deqmcl tune``: successive halving of candidates over segments of logs, all on the same ones.

Candidates come in rounds. A round measures its candidates on a ninth of the training segments, a
third of them go on to a third of the segments, and a third of these to all (Jamieson & Talwalkar
2016, η = 3). Half of each later round is drawn near the two best so far. The held-out segments are
run once, at the end, by the default and by the winner.
"""

import json
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import to_builtins

from benchmarks.files import is_empty
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.sweeps.manifest import differences
from benchmarks.sweeps.running import Options, TrialsFailedError, run_missing
from benchmarks.sweeps.store import Store, writing
from benchmarks.tables.frames import milliseconds_per_step
from benchmarks.trials.attempt import provenance_of
from benchmarks.trials.provenance import Provenance
from benchmarks.trials.scoring import Finished
from benchmarks.tuning.segments import DRAWS, ORDER, Segment, stream
from benchmarks.tuning.space import beside, spread
from benchmarks.tuning.task import ETA, Task, value_of
from deqmcl_gym.files import UnreadableError, content_of, json_of, write_text
from deqmcl_gym.validation import InputError

STATE = "tune.json"
ROUND = 18  # candidates
RUNS = 3  # of default and winner on each held-out segment
_FINALISTS, _FINAL_RUNS = 3, 2


_FAILED = math.nan, math.nan  # score and ms per step of a run


@dataclass(kw_only=True)
class Tried:
    """A candidate, as far as it has come.

    Attributes:
        values: what it changes; nothing is the default.
        round: in which it was drawn.
        free: whether it was drawn from the whole space.
        rank: in the first rung of its round, from 0 (best) to 1.
        segments: how many it has run on.
        value: its mean score over them; inf if a run failed.
        ms: median ms per step; NaN unknown.
    """

    values: Overrides
    round: int
    free: bool
    rank: float = math.nan
    segments: int = 0
    value: float = math.inf
    ms: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Found:
    """What came of a search.

    Attributes:
        task: what was searched.
        tried: all candidates, the default first.
        best: the winner; the default if nothing was better on the training segments.
        default_runs, best_runs: of each held-out segment.
    """

    task: Task
    tried: Sequence[Tried]
    best: Tried
    default_runs: Sequence[Sequence[Finished]]
    best_runs: Sequence[Sequence[Finished]]


@dataclass
class Searching:
    """A search in its folder.

    Attributes:
        task: what is searched.
        store: of its runs.
        options: how they run.
        now: what their numbers depend on.
    """

    task: Task
    store: Store
    options: Options
    now: Provenance
    _measured: dict[tuple[Overrides, int, int], tuple[float, float]] = field(default_factory=dict)

    def found(self, candidates: int) -> Found:
        """Search until so many candidates were tried.

        Raises:
            TrialsFailedError: the default fails.
        """
        tried: list[Tried] = []
        for number, before in enumerate(range(0, candidates, ROUND)):
            tried += self._round(number, min(ROUND, candidates - before), tried)
            best, default = self._best(tried)[0], tried[0]
            print(
                f"deqmcl: round {number + 1}: {len(tried)} of {candidates} candidates; on the "
                f"training segments default {default.value:.3f}, best {best.value:.3f}",
                file=sys.stderr,
                flush=True,
            )
        best = self._final(tried)
        asked = [NOTHING] + [best.values] * (best is not tried[0])
        self._run(asked, self.task.held_out, RUNS)
        default_runs, best_runs = (self._held_out(one) for one in (NOTHING, best.values))
        return Found(
            task=self.task, tried=tried, best=best, default_runs=default_runs, best_runs=best_runs
        )

    def _round(self, number: int, count: int, before: Sequence[Tried]) -> list[Tried]:
        """Draw the candidates of a round and halve them."""
        task = self.task
        order = stream(task.seed, ORDER, number).permutation(len(task.training))
        drawn = self._drawn(number, count, before)
        alive = list(drawn)
        for rung, size in enumerate(task.rungs):
            segments = [task.training[i] for i in order[:size]]
            self._run([one.values for one in alive], segments, 1)
            for one in alive:
                self._judge(one, segments, 1)
            self._refuse_unscored(drawn[0], segments, 1)
            alive.sort(key=self._key)
            if rung == 0:
                for place, one in enumerate(alive):
                    one.rank = place / max(1, len(alive) - 1)
            if size < len(task.training):
                kept = alive[: -(-len(alive) // ETA)]
                lost = [one for one in alive if one.values == NOTHING and one not in kept]
                alive = kept + lost  # the default is compared with to the end
        return drawn

    def _drawn(self, number: int, count: int, before: Sequence[Tried]) -> list[Tried]:
        """Return the candidates of a round; after the first, fewer are some of ``ROUND``."""
        task, rng = self.task, stream(self.task.seed, DRAWS, number)
        near = ROUND // 2 if number else 0
        free = spread(task.space, (ROUND if number else count - 1) - near, rng)
        drawn = [Tried(values=NOTHING, round=0, free=False)] * (number == 0)
        drawn += [Tried(values=values, round=number, free=True) for values in free]
        drawn = drawn[: count - count * near // ROUND]
        for i in range(count * near // ROUND):
            parent = self._best(before)[i % 2].values
            values = beside(task.space, parent, task.usual, rng)
            drawn.append(Tried(values=values, round=number, free=False))
        return drawn

    def _final(self, tried: Sequence[Tried]) -> Tried:
        """Return the winner: the best and the default once more on all training segments."""
        task = self.task
        last = self._best(tried)[:_FINALISTS]
        last += [tried[0]] * (tried[0] not in last)
        self._run([one.values for one in last], task.training, _FINAL_RUNS)
        for one in last:
            self._judge(one, task.training, _FINAL_RUNS)
        self._refuse_unscored(tried[0], task.training, _FINAL_RUNS)
        return min(last, key=self._key)

    def _best(self, tried: Sequence[Tried]) -> list[Tried]:
        """Those that ran on all training segments, the best first."""
        whole = [one for one in tried if one.segments == len(self.task.training)]
        return sorted(whole, key=self._key)

    def _key(self, one: Tried) -> tuple[bool, bool, float, bool]:
        """Return what is smaller for the better one; of equals, the default is better."""
        slow = self.task.max_ms is not None and not one.ms <= self.task.max_ms
        value = self.task.goal.sign * one.value
        return not math.isfinite(one.value), slow, value, one.values != NOTHING

    def _judge(self, one: Tried, segments: Sequence[Segment], runs: int) -> None:
        """Set a candidate's score on segments, each counting as much as any other."""
        each = [self._measured[one.values, s.number, run] for s in segments for run in range(runs)]
        values, times = np.array(each).T
        one.segments = len(segments)
        one.value = math.inf if np.isnan(values).any() else float(np.mean(values))
        known = times[~np.isnan(times)]
        one.ms = float(np.median(known)) if known.size else math.nan

    def _refuse_unscored(self, one: Tried, segments: Sequence[Segment], runs: int) -> None:
        """Refuse a default that failed, or that has no such score."""
        if one.values != NOTHING or math.isfinite(one.value):
            return
        for segment, run in product(segments, range(runs)):
            trial = self.task.trial(NOTHING, segment, run)
            if why := self.store.failure(self.now.key(trial)):
                raise TrialsFailedError(
                    f"the default of {self.task.localizer} failed on the segment at "
                    f"{segment.begins:.1f} s: {why.rstrip('.')}. --retry-failed runs it again."
                )
        raise InputError(
            f"--score is {self.task.score}, which {self.task.localizer} does not have: choose "
            "another one."
        )

    def _run(self, candidates: Sequence[Overrides], segments: Sequence[Segment], runs: int) -> None:
        """Run what was not yet run; of each run the score and the time are kept in memory."""
        asked = [
            (one, segment, run)
            for one in candidates
            for segment in segments
            for run in range(runs)
            if (one, segment.number, run) not in self._measured
        ]
        trials = {self.now.key(t): t for t in (self.task.trial(*one) for one in asked)}
        run_missing(trials, self.store, self.options, self.now)
        for one, segment, run in asked:
            record = self._record(one, segment, run)
            measured = _FAILED
            if record is not None:
                measured = value_of(self.task.goal, record), milliseconds_per_step([record])
            self._measured[one, segment.number, run] = measured

    def _record(self, one: Overrides, segment: Segment, run: int) -> Finished | None:
        trial = self.task.trial(one, segment, run)
        return self.store.get(self.now.key(trial), trial)

    def _held_out(self, one: Overrides) -> list[list[Finished]]:
        """Return the finished runs of a candidate by held-out segment."""
        each = [[self._record(one, s, run) for run in range(RUNS)] for s in self.task.held_out]
        return [[record for record in own if record is not None] for own in each]


@contextmanager
def searching(task: Task, out: Path, options: Options) -> Iterator[Searching]:
    """Open the folder of a search that was checked: a new one, or one that goes on."""
    first = {one.world["log"]: one for one in task.segments}
    now = provenance_of([task.trial(NOTHING, one, 0) for one in first.values()])
    ours = json.loads(json.dumps({"search": task.identity, **to_builtins(now)}))
    if not is_empty(out) and (apart := list(differences(_identity(out), ours))):
        raise InputError(
            f"{out} holds a search for something else ({'; '.join(apart[:3])}): give a new "
            "--out, or the same options."
        )
    with writing(out) as store:
        write_text(out / STATE, json.dumps(ours, indent=1) + "\n")
        yield Searching(task, store, options, now)


def _identity(out: Path) -> Any:
    """Return what the search in a folder depends on."""
    try:
        return json_of(content_of(out / STATE))
    except FileNotFoundError:
        raise InputError(f"{out} holds files, but no {STATE}: give a new --out.") from None
    except UnreadableError as error:
        raise InputError(f"{out / STATE} {error}: give a new --out.") from None
