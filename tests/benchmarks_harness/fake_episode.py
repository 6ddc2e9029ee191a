"""Episodes of beliefs made by hand: state s is seen with an error that tells s apart."""

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.trials import Trial
from benchmarks.trials.episode import Step
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import Trace

TASK = Stage.of(Trial(scenario="paper", localizer="mcl", params={}, lag=0, seed=0, trial=0)).task
FREE, IN_WALL = (50.0, 50.0, 0.0), (175.0, 150.0, 0.0)  # a corner of the loop; the inner rectangle
USABLE = np.array([100.0])


def error_of(state, offset):
    """Powers of two: the sum over states tells which states it covers."""
    return 2.0**state * (1 if offset == 0 else 3 if offset < 0 else 5)


@dataclass
class FakeBelief:
    """Holds points by offset; what is not in ``held`` is not held."""

    held: dict
    quality: object = None

    def points(self, offset=0):
        return self.held.get(offset)


def truth_of(state):
    return np.array([100.0 + state, 50.0, 0.5])


def one_point(state, offset):
    """A pose ``error_of`` px off the truth along x."""
    return truth_of(state)[None] + [error_of(state, offset), 0, 0], np.ones(1)


def episode(steps, offsets, *, points=one_point, ranges=lambda t: USABLE, action=lambda t: None):
    """Yield moments 0 … steps; offset k is held where the state t + k is one of 0 … steps."""
    for t in range(steps + 1):
        held = {k: points(t + k, k) for k in offsets if 0 <= t + k <= steps}
        yield Step(t, truth_of(t), ranges(t), FakeBelief(held), 0.25, action(t))


def mean_error(states, offset):
    """The mean of ``error_of`` by a plain loop; NaN of nothing."""
    states = list(states)
    return sum(error_of(s, offset) for s in states) / len(states) if states else math.nan


def traced(steps, offsets, scored=None, thresholds=TASK.thresholds, **how):
    task = replace(TASK, thresholds=thresholds)
    return Trace(episode(steps, offsets, **how), scored or offsets, task)
