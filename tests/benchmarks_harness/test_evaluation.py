"""``benchmarks.evaluate``: a policy's row, paired with a reference in the same episodes."""

import math

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused

import benchmarks

QUICK = {
    "floor_plan": {"office": {"wings": 1, "corridors": 1, "seed": 3}},
    "localizer": {"name": "mcl-map", "particles": 500},
    "max_steps": 40,
}


def spinning(seen, info):
    """Turns on the spot, and declares as the references do."""
    sure = float(seen["confident"][0] >= 1.0)
    return np.array([0.0, 0.0 if sure else math.pi / 12, sure], np.float32)


class Model:
    """Has ``predict``, as models of Stable-Baselines3; notes with which state it was asked."""

    def __init__(self):
        self.asked = []

    def predict(self, seen, state=None, episode_start=None, deterministic=False):
        self.asked.append((state, bool(episode_start[0]), deterministic))
        return spinning(seen, {}), (0 if state is None else state + 1)


def test_a_policy_that_does_what_the_reference_does_gains_nothing_in_any_form():
    model = Model()
    rows = [
        benchmarks.evaluate("Localize-v0", policy, episodes=3, **QUICK).row
        for policy in (spinning, model)
    ]
    assert [row["gain"] for row in rows] == [0.0, 0.0]
    assert rows[0]["policy"] == "spinning"
    begun = [asked for asked in model.asked if asked[1]]
    assert begun == [(None, True, True)] * 3
    assert all(state is not None for state, first, _ in model.asked if not first)


def test_the_return_is_that_of_the_env_whatever_it_is_wrapped_in():
    def small(env):
        return gym.wrappers.TransformReward(env, lambda reward: reward / 100)

    plain, wrapped = (
        benchmarks.evaluate("Localize-v0", spinning, episodes=2, wrap=wrap, reference=None, **QUICK)
        for wrap in (None, small)
    )
    assert plain.episodes.equals(wrapped.episodes)
    assert (plain.episodes["return"] < -10).all()


def test_a_row_counts_what_happened():
    played = benchmarks.evaluate("Sharp-v0", "plan", episodes=3, reference=None)
    done, row = played.episodes["done"], played.row
    assert 0 < done.sum() < 3  # noise leaves the robot short of the line in one of them
    assert (played.episodes["return"] == 992).equals(done)  # the most that a lap pays
    assert row["done low"] < row["done"] == done.mean() < row["done high"]
    assert row["steps"] == played.episodes["steps"][done].max()  # the middle of two and infinity
    assert row["metres"] == pytest.approx(18.0, abs=0.5)  # 900 px, the lap
    assert "plan in Sharp-v0, 3 episodes: return" in str(played)


@pytest.mark.parametrize(
    ("task", "policy", "options", "words"),
    [
        ("Lokalize-v0", spinning, {}, "unknown task 'Lokalize-v0': did you mean"),
        ("Localize-v0", "spinn", {}, "unknown policy of Localize-v0 'spinn': did you mean 'spin'"),
        ("Localize-v0", spinning, {"episodes": 0}, "episodes is 0"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(task, policy, options, words):
    with refused(words):
        benchmarks.evaluate(task, policy, **{"reference": None} | options)


def test_a_reference_of_other_episodes_is_refused():
    base = benchmarks.evaluate("Room-v0", "spin", episodes=1, reference=None)
    with refused("the reference has 1 episodes, but 2 are played"):
        benchmarks.evaluate("Room-v0", "still", episodes=2, reference=base)
