"""``deqmcl tune``: successive halving of candidates over segments of logs, all on the same ones.

A round measures candidates on a ninth of the training segments, a third of them goes on to a third,
and a third of these to all (Jamieson & Talwalkar 2016, η = 3); half of each later round is near the
two best. The default and the winner run on the held-out segments, once. What beliefs are worth is
judged by the published covariance, calibrated to each candidate's errors on training segments.
"""

import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, product
from pathlib import Path

import msgspec
import numpy as np
import pandas as pd
from numpy.random import Generator

from benchmarks.robots import SCENARIO, Replay
from benchmarks.robots.space import ASSUMED, Space, ends_of, latin_hypercube, neighbour
from benchmarks.setup.logs import REPLAY
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.sweeps.manifest import differences
from benchmarks.sweeps.running import Options, TrialsFailedError, run_missing
from benchmarks.sweeps.store import Store, is_empty, writing
from benchmarks.tables.frames import RUN, milliseconds_per_step
from benchmarks.trials import Provenance, Trial, stream
from benchmarks.trials.scores import JOURNEY_SCORES, TRACK_SCORES, Score, published_scores
from benchmarks.trials.scoring import Finished, TrialRecord
from benchmarks.trials.stage import Stage, attempt, check_trials, key_of, provenance_of
from deqmcl_gym.files import UnreadableError, content_of, json_of, write_bytes
from deqmcl_gym.logs import Log
from deqmcl_gym.validation import InputError, amount
from localizers import Calibration

BELIEVED = "believed_95"  # share inside the 95 % region of a belief itself
STATE = "tune.json"
ROUND = 18  # candidates
ETA = 3  # of candidates, one of so many goes on
RUNS = 3  # of default and winner on each held-out segment
_FINALISTS, _FINAL_RUNS = 3, 2
_MOST, _LEAST = 24, 2  # segments of each kind
_REFERENCED = 0.5  # share of a segment's records that must have a reference
_TRIES = 100  # to draw a start in free space
# keys of the streams of a search, which are of none of its trials
_STARTS, _DRAWS, _ORDER = (7, 0), (7, 1), (7, 2)

GOALS = {
    "median": TRACK_SCORES["position_median"],
    "p95": TRACK_SCORES["position_p95"],
    "localized": TRACK_SCORES["within_1m"],
    "false-commitment": replace(
        JOURNEY_SCORES["false_steps"],
        unit="share",
        words="share of records with quality above 0.5 while more than 2 m off",
    ),
    "log-score": TRACK_SCORES["log_score"],
}
_NEEDS = {"false-commitment": "quality", "log-score": "spread"}  # of a belief


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Part of a log, from a start that is known with some error."""

    number: int  # among all; it names the random streams of its runs
    begins: float  # time of its first record, s
    metres: float  # driven in it
    whole: Overrides  # the whole log, as trials have it
    world: Overrides  # what is played of it
    assumed: Overrides  # by the filters, the noise of the whole log and the start among it


def cut(
    replays: Sequence[Replay], length: float, gap: float, sd: tuple[float, float], seed: int
) -> tuple[list[Segment], list[Segment]]:
    """Cut logs, in m, into segments that are trained on, and held out, in turn.

    Of ``length`` m with ``gap`` m driven between two. The errors of the starts are normal with
    these ``sd`` (m, rad), drawn again where no robot can be.
    """
    parts = [(replay, *ends) for replay in replays for ends in _ends(replay, length, gap)]
    kinds = parts[0::2], parts[1::2]
    if min(map(len, kinds)) < _LEAST:
        raise InputError(
            f"the log gives {amount(len(parts), 'segment')} of {length:g} m with a reference, but "
            f"{2 * _LEAST} or more are needed: give a smaller --segment, or more logs."
        )
    training, held_out = (
        [kind[i] for i in np.linspace(0, len(kind) - 1, min(len(kind), _MOST)).astype(int)]
        for kind in kinds
    )
    segments = [
        _segment(number, replay, first, last, sd, stream(seed, *_STARTS, number))
        for number, (replay, first, last) in enumerate(training + held_out)
    ]
    return segments[: len(training)], segments[len(training) :]


def _ends(replay: Replay, length: float, gap: float) -> Iterator[tuple[int, int]]:
    """Yield the first and the last record of each segment of a log."""
    whole = replay.scenario.whole
    referenced, way, at = whole.referenced, whole.driven, 0
    while (begin := np.searchsorted(referenced, at)) < referenced.size:
        first = int(referenced[begin])
        last = int(np.searchsorted(way, way[first] + length))
        if last >= len(whole):
            return
        inside = np.searchsorted(referenced, last, side="right") - begin
        at = first + 1
        if inside >= _REFERENCED * (last - first + 1):
            yield first, last
            at = max(last + 1, int(np.searchsorted(way, way[last] + gap)))


def _segment(
    number: int, replay: Replay, first: int, last: int, sd: tuple[float, float], rng: Generator
) -> Segment:
    """Return the records from the first to the last, both included."""
    whole, ground = replay.scenario.whole, replay.scenario.recording()[1]
    assert whole.reference is not None
    true = whole.reference[first]
    starts = true + rng.standard_normal((_TRIES, 3)) * [sd[0], *sd]
    mean = [*starts, true][int(np.argmax([*ground.free(starts), True]))]
    mean[2] = math.remainder(mean[2], 4 * math.pi)  # within 2π, as a pose must be
    noise = {f"motion.{n}": v for n, v in vars(replay.motion).items() if n != "still"}
    prior = {"prior.mean": tuple(mean.tolist()), "prior.sd_position": sd[0]}
    log = Overrides({name: value for name, value in replay.world.items() if name != "judged"})
    return Segment(
        number=number,
        begins=float(whole.times[first]),
        metres=float(whole.driven[last] - whole.driven[first]),
        whole=log,
        world=log | {"start": first, "length": last - first + 1},
        assumed=Overrides({**noise, **replay.assumed, **prior, "prior.sd_heading": sd[1]}),
    )


@dataclass(frozen=True, kw_only=True)
class Task:
    """What is searched for, and on what: all that a search depends on, but for its code."""

    localizer: str
    score: str  # a name in ``GOALS``; a search compares its means over segments
    max_ms: float | None  # most ms per step that a winner may take; None: any
    seed: int
    base: Overrides  # the localizer's parameters before the search
    usual: Overrides  # values of the default, as far as they are known, by name in ``space``
    space: Space
    training: Sequence[Segment]  # segments that the search sees
    held_out: Sequence[Segment]  # and those that it does not see

    @property
    def goal(self) -> Score:
        """The score."""
        return GOALS[self.score]

    def trial(self, values: Overrides, segment: Segment, run: int = 0) -> Trial:
        """Return a run on a segment with the values of a candidate."""
        assumed = {n: v for n, v in values.items() if n.partition(".")[0] in ASSUMED}
        params = {n: v for n, v in values.items() if n not in assumed}
        if self.localizer == "amcl" and "z_hit" in params and "z_rand" not in params:
            params["z_rand"] = round(1 - params["z_hit"], 12)  # Nav2: "all z must sum to 1"
        return Trial(
            scenario=SCENARIO,
            world=segment.world,
            assumed=segment.assumed | assumed,
            localizer=self.localizer,
            params=self.base | params,
            lag=0,
            seed=self.seed,
            trial=segment.number,
            filter_seed=run,
        )

    @property
    def of_logs(self) -> list[Trial]:
        """A run of the default on each log."""
        of_logs = {part.world["log"]: part for part in (*self.training, *self.held_out)}
        return [self.trial(NOTHING, part) for part in of_logs.values()]

    def check(self) -> None:
        """Set up each log, let the localizer look at the ends of all ranges, and run it once."""
        for trial in self.of_logs:
            Stage.of(trial).check()
        ends = [Overrides({name: v}) for name, span in self.space.items() for v in ends_of(span)]
        try:
            check_trials([self.trial(values, self.training[0]) for values in (NOTHING, *ends)])
        except InputError as error:
            raise InputError(f"the default, or an end of a range, is refused: {error}") from None
        trial = self.trial(NOTHING, self.training[0])
        record = attempt(trial, key_of(trial)).record  # if it fails, the search says why
        if record is not None and self.goal.name not in _scores(record):
            others = ", ".join(name for name in GOALS if name != self.score)
            raise InputError(
                f"--score is {self.score}, but a belief of {self.localizer} has no "
                f"{_NEEDS.get(self.score, self.score)}: choose another one of {others}."
            )


@dataclass(kw_only=True, eq=False)
class Candidate:
    """Values that are tried, and how far they have come."""

    values: Overrides  # what is changed of the default, which changes nothing
    round: int  # in which it was drawn
    whole_space: bool  # whether it was drawn from all of the space
    rank: float = math.nan  # in the first rung of its round, from 0 (best) to 1
    segments: int = 0  # how many it has run on
    value: float = math.inf  # its mean score over them; inf if a run failed
    ms_per_step: float = math.nan  # median; NaN unknown


def _scores(record: TrialRecord | None) -> dict[str, float]:
    """Return the scores of a run on a log; nothing if it failed."""
    parts = (record.journey, record.track) if record else ()  # of one name the track's counts
    each = chain(*(part.scores.items() for part in parts if part is not None))
    return {name: float(value) for name, value in each if value is not None}


@lru_cache(maxsize=2 * _MOST)
def _log_of(world: Overrides) -> Log:
    return REPLAY.changed(world).recording()[0]


def _judged(
    runs: Sequence[Finished | None], by: Calibration | None = None
) -> tuple[list[dict[str, float]], Calibration]:
    """Return scores of runs, covariances published by a calibration, fitted if None, and that."""
    tracks = [run.track.on(_log_of(run.trial.world)) if run and run.track else None for run in runs]
    if by is None:
        each = [track.deviations() for track in tracks if track]
        fitted = map(np.concatenate, zip(*each, strict=True))
        by = Calibration.fitted(*fitted) if any(len(off) for off, _ in each) else Calibration()
    rows = []
    for scores, track in zip(map(_scores, runs), tracks, strict=True):
        published = published_scores(track, 0, by) if track else {}
        rows.append(scores | {BELIEVED: scores.get("coverage_95", math.nan)} | published)
    return rows, by


class Search:
    """A search in its folder, and what came of it."""

    best: Candidate  # the winner; the default if nothing was better on the training segments
    # held-out runs by ``which`` ("default", "tuned") and ``RUN``: scores, ms_per_step; NaN: failed
    held_out: pd.DataFrame
    calibrations: Mapping[str, Calibration]  # by ``which``, fitted on the training segments

    def __init__(self, task: Task, store: Store, options: Options, now: Provenance) -> None:
        self.task, self.store, self.options = task, store, options
        self.now = now  # what its numbers depend on
        self.tried: list[Candidate] = []  # all of them, the default first
        self._asked = set[str]()  # keys of trials

    def run(self, candidates: int) -> None:
        """Search until so many candidates were tried; if the default fails, raise an error."""
        tried, begun = self.tried, time.monotonic()
        for number, before in enumerate(range(0, candidates, ROUND)):
            tried += self._drawn(number, min(ROUND, candidates - before))
            self._halve(number, tried[before:])
            print(
                f"deqmcl: round {number + 1}: {len(tried)} of {candidates} candidates after "
                f"{(time.monotonic() - begun) / 60:.1f} min; on the training segments default "
                f"{tried[0].value:.3f}, best {self._ranked[0].value:.3f}",
                file=sys.stderr,
                flush=True,
            )
        last = [*dict.fromkeys([*self._ranked[:_FINALISTS], tried[0]])]
        self._measure(last, self.task.training, _FINAL_RUNS)
        self.best = min(last, key=self._key)
        both, which = [NOTHING, self.best.values], ("default", "tuned")
        trained = self._runs(both, self.task.training, _FINAL_RUNS)
        fitted = [_judged(runs)[1] for runs in trained]
        held = self._runs(both, self.task.held_out, RUNS)
        rows = chain(*(_judged(runs, by)[0] for runs, by in zip(held, fitted, strict=True)))
        index = pd.MultiIndex.from_product(
            [which, range(len(self.task.held_out)), range(RUNS)], names=["which", *RUN]
        )
        columns = [*(TRACK_SCORES | JOURNEY_SCORES), BELIEVED]
        times = [milliseconds_per_step([run] if run else []) for run in chain(*held)]
        self.held_out = pd.DataFrame([*rows], index, columns, float).assign(ms_per_step=times)
        self.calibrations = dict(zip(which, fitted, strict=True))

    def _drawn(self, number: int, count: int) -> list[Candidate]:
        """Return the candidates of a round; a smaller later round has part of a whole one."""
        task, rng = self.task, stream(self.task.seed, *_DRAWS, number)
        near, strips = (count // 2, ROUND - ROUND // 2) if number else (0, count - 1)
        whole = latin_hypercube(task.space, strips, rng)[: count - near]
        best = [candidate.values for candidate in self._ranked]
        beside = [neighbour(task.space, best[i % 2], task.usual, rng) for i in range(near)]
        default = [] if number else [NOTHING]
        drawn = [(default, False), (whole, True), (beside, False)]
        return [Candidate(values=v, round=number, whole_space=w) for some, w in drawn for v in some]

    def _halve(self, number: int, candidates: Sequence[Candidate]) -> None:
        """Measure the candidates of a round on more and more segments, the better ones on all."""
        alive, training, most = list(candidates), self.task.training, len(self.task.training)
        order = stream(self.task.seed, *_ORDER, number).permutation(most)
        for size in sorted({-(-most // ETA**2), -(-most // ETA), most}):
            self._measure(alive, [training[i] for i in order[:size]], 1)
            alive.sort(key=self._key)
            for place, candidate in enumerate(alive):
                if math.isnan(candidate.rank):
                    candidate.rank = place / max(1, len(alive) - 1)
            better = alive[: -(-len(alive) // ETA)]
            # the default is compared with to the end
            alive = better + [a for a in alive if a.values == NOTHING and a not in better]

    @property
    def _ranked(self) -> list[Candidate]:
        """Those that ran on all training segments, the best first."""
        whole = [tried for tried in self.tried if tried.segments == len(self.task.training)]
        return sorted(whole, key=self._key)

    def _key(self, candidate: Candidate) -> tuple[bool, bool, float, bool]:
        """Return what is smaller for the better one; of equals, the default is better."""
        most, value = self.task.max_ms, candidate.value
        slow = most is not None and not candidate.ms_per_step <= most
        cost = self.task.goal.sign * value
        return not math.isfinite(value), slow, cost, candidate.values != NOTHING

    def _measure(self, candidates: list[Candidate], segments: Sequence[Segment], runs: int) -> None:
        """Set the scores of candidates on segments; refuse a default that has none."""
        each = self._runs([candidate.values for candidate in candidates], segments, runs)
        goal = self.task.goal.name
        for candidate, records in zip(candidates, each, strict=True):
            rows = _judged(records)[0] if goal == "log_score" else map(_scores, records)
            values = [row.get(goal, math.nan) for row in rows]
            candidate.segments = len(segments)
            candidate.value = math.inf if np.isnan(values).any() else float(np.mean(values))
            candidate.ms_per_step = milliseconds_per_step([*filter(None, records)])
            if candidate.values == NOTHING and math.isinf(candidate.value):
                segment, run = divmod(int(np.isnan(values).argmax()), runs)
                self._refuse_default(segments[segment], run)

    def _refuse_default(self, segment: Segment, run: int) -> None:
        task, where = self.task, f"on the segment at {segment.begins:.1f} s"
        default = f"the default of {task.localizer}"
        why = self.store.failure(self.now.key(task.trial(NOTHING, segment, run)))
        if why is None:
            raise InputError(f"{default} has no {task.score} {where}: choose another --score.")
        raise TrialsFailedError(
            f"{default} failed {where}: {why.rstrip('.')}. --retry-failed runs it again."
        )

    def _runs(
        self, candidates: Sequence[Overrides], segments: Sequence[Segment], runs: int
    ) -> list[list[Finished | None]]:
        """Run what was not yet run; return the runs of each candidate, by segment and run."""
        each = [*product(segments, range(runs))]
        rows = [[self.task.trial(values, *run) for run in each] for values in candidates]
        trials = {self.now.key(trial): trial for trial in chain(*rows)}
        new = {key: trial for key, trial in trials.items() if key not in self._asked}
        run_missing(new, self.store, self.options, self.now)
        self._asked.update(new)
        return [[self.store.get(self.now.key(trial), trial) for trial in row] for row in rows]


def search(task: Task, out: Path, options: Options, candidates: int) -> Search:
    """Search, if ``task`` was checked, in a new folder, or go on in that of this search."""
    now = provenance_of(task.of_logs)
    state = msgspec.json.encode({"search": task, "made_by": now}, enc_hook=Overrides.json)
    if not is_empty(out):
        try:
            changes = [*differences(json_of(content_of(out / STATE)), json_of(state))]
        except FileNotFoundError:
            raise InputError(f"{out} holds files, but no {STATE}: give a new --out.") from None
        except UnreadableError as error:
            raise InputError(f"{out / STATE} {error}: give a new --out.") from None
        if changes:
            raise InputError(
                f"{out} holds a search for something else ({'; '.join(changes[:3])}): give a new "
                "--out, or the same options."
            )
    with writing(out) as store:
        write_bytes(out / STATE, msgspec.json.format(state, indent=1) + b"\n")
        found = Search(task, store, options, now)
        found.run(candidates)
        return found
