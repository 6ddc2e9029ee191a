"""Dead reckoning: the commands added up from the prior's mean, and the plan beyond."""

import math

import numpy as np
import pytest

import localizers


def test_it_adds_the_commands_up_and_rolls_the_plan_out(robot, prior):
    square = np.array([(10.0, math.pi / 2)] * 4)
    localizer = localizers.make("dead-reckoning", robot)
    belief = localizer.reset(prior, square, np.random.default_rng(0))
    x, y, heading = prior.mean
    corners = [(x, y), (x, y + 10), (x - 10, y + 10), (x - 10, y), (x, y)]
    for t in range(5):
        for offset in range(-6, 7):
            points = belief.points(offset)
            if not 0 <= t + offset <= 4:
                assert points is None
                continue
            assert points[1].tolist() == [1.0]
            assert points[0][0, :2] == pytest.approx(corners[t + offset], abs=1e-12)
            assert points[0][0, 2] == pytest.approx(heading + (t + offset) * math.pi / 2)
        if t < 4:
            belief = localizer.update([math.nan], square[t], square[t + 1 :])


def test_it_follows_what_was_carried_out_not_what_was_planned(robot, prior):
    localizer = localizers.make("dead-reckoning", robot)
    localizer.reset(prior, [(10.0, 0.0), (10.0, 0.0)], np.random.default_rng(0))
    belief = localizer.update([100.0], [3.0, 0.0], [(7.0, 0.0)])
    x, y, _ = prior.mean
    assert belief.points()[0][0, :2].tolist() == [x + 3, y]
    assert belief.points(1)[0][0, :2].tolist() == [x + 10, y]
