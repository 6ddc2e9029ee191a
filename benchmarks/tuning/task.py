"""What ``deqmcl tune`` is to find: the score that is to be best, the localizer, space and segments.

A score is of a run on a segment, and a search compares means over segments.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

from msgspec import to_builtins

from benchmarks.replay.options import NAME
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.trials.scores import JOURNEY_SCORES, TRACK_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage, check_trials
from benchmarks.tuning.segments import Segment
from benchmarks.tuning.space import ASSUMED, Space
from deqmcl_gym.validation import InputError
from localizers import Belief, quality_of
from localizers.kinds import is_ctrl_c

ETA = 3  # of candidates, one of so many goes on


def _spread(belief: Belief) -> bool:
    """Whether it is more than one point, or says nothing of the present."""
    points = belief.points()
    return points is None or len(points[1]) > 1


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
# what a belief must have for a goal, in a word, and whether it has
_NEEDS: dict[str, tuple[str, Callable[[Belief], bool]]] = {
    "false-commitment": ("quality", lambda belief: quality_of(belief) is not None),
    "log-score": ("spread", _spread),
}


def value_of(score: Score, record: Finished) -> float:
    """Return a score of a run on a log; NaN is not available."""
    journey = {} if record.journey is None else record.journey.scores
    value = ({} if record.track is None else record.track.scores).get(score.name)
    value = journey.get(score.name) if value is None else value
    return math.nan if value is None else float(value)


@dataclass(frozen=True, kw_only=True)
class Task:
    """What is searched for, and on what.

    Attributes:
        localizer: its name.
        base: its parameters before the search.
        usual: values of the default, as far as they are known, by name in ``space``.
        space: what is searched.
        segments: to train on and held out.
        score: a name in ``GOALS``.
        max_ms: most ms per step that a winner may take; None: any.
        seed: root of all randomness.
    """

    localizer: str
    base: Overrides
    usual: Mapping[str, Any]
    space: Space
    segments: Sequence[Segment]
    score: str
    max_ms: float | None
    seed: int

    @property
    def goal(self) -> Score:
        """The score."""
        return GOALS[self.score]

    @property
    def training(self) -> list[Segment]:
        """The segments that the search sees."""
        return [one for one in self.segments if not one.held_out]

    @property
    def held_out(self) -> list[Segment]:
        """Those that it does not."""
        return [one for one in self.segments if one.held_out]

    @property
    def rungs(self) -> list[int]:
        """How many training segments candidates run on, rung by rung."""
        count = len(self.training)
        return sorted({-(-count // ETA**2), -(-count // ETA), count})

    def parts(self, candidate: Overrides) -> tuple[Overrides, Overrides]:
        """Return the parameters of the localizer, and what it assumes beside the log's own."""
        assumed = {n: v for n, v in candidate.items() if n.partition(".")[0] in ASSUMED}
        own = {n: v for n, v in candidate.items() if n not in assumed}
        if self.localizer == "amcl" and "z_hit" in own and "z_rand" not in own:
            own["z_rand"] = round(1 - own["z_hit"], 12)  # Nav2: "all z must sum to 1"
        return self.base | own, Overrides(assumed)

    def trial(self, candidate: Overrides, segment: Segment, run: int) -> Trial:
        """Return the run of a candidate on a segment."""
        params, assumed = self.parts(candidate)
        return Trial(
            scenario=NAME,
            world=segment.world,
            assumed=segment.assumed | assumed,
            localizer=self.localizer,
            params=params,
            lag=0,
            seed=self.seed,
            trial=segment.number,
            filter_seed=run,
        )

    def check(self) -> None:
        """Set up each log, let the localizer look at the ends of all ranges, and begin a run."""
        first = {one.world["log"]: one for one in self.segments}
        for one in first.values():
            Stage.of(self.trial(NOTHING, one, 0)).check()
        ends = [Overrides({name: end}) for name, one in self.space.items() for end in one.ends]
        try:
            check_trials([self.trial(one, self.segments[0], 0) for one in (NOTHING, *ends)])
        except InputError as error:
            raise InputError(f"the default, or an end of a range, is refused: {error}") from None
        _check_score(self.trial(NOTHING, self.training[0], 0), self.score)

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that the search depends on, but for its code and how long it goes on."""
        return {
            "localizer": self.localizer,
            "params": self.base.json(),
            "space": {name: to_builtins(one) for name, one in self.space.items()},
            "score": self.score,
            "max_ms": self.max_ms,
            "seed": self.seed,
            "segments": [
                [one.held_out, one.world.json(), one.assumed.json()] for one in self.segments
            ],
        }


def _check_score(trial: Trial, name: str) -> None:
    """Take the first step of a run, and refuse a score that its belief has nothing for."""
    if name not in _NEEDS:
        return
    need, has = _NEEDS[name]
    try:
        *_, last = islice(Stage.of(trial).moments(), 2)
        given = has(last.belief)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return
    if not given:
        others = ", ".join(own for own in GOALS if own != name)
        raise InputError(
            f"--score is {name}, but a belief of {trial.localizer} has no {need}: choose "
            f"another one of {others}."
        )
