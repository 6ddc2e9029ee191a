"""What is compared: rates by turns, targets read the right way round, sides that do the same."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.studies.speed import steps, worlds
from benchmarks.studies.speed.command import FIGURES, PEERS
from benchmarks.studies.speed.figure import (
    Effort,
    Figure,
    Job,
    Published,
    Side,
    is_time,
    measured,
    rates,
)
from benchmarks.studies.speed.work import fan, replanned_lap

DOCS = Path(__file__).parents[2] / "docs" / "speed.md"
ONCE = Effort(repeats=1, seconds=0.0)


class Clock:
    """Time that passes only as jobs say; notes who ran."""

    def __init__(self):
        self.now, self.log = 0.0, []

    def job(self, name, seconds, amount=1.0):
        def call():
            self.log.append(name)
            self.now += seconds(len(self.log)) if callable(seconds) else seconds

        return Job(call, amount, clock=lambda: self.now)


def test_jobs_take_turns_that_are_at_least_as_long_as_asked_for():
    clock = Clock()
    jobs = [clock.job("a", 0.01, amount=50), clock.job("b", 0.05), clock.job("c", 1.0)]
    assert rates(jobs, Effort(repeats=2, seconds=0.1)) == pytest.approx([5000, 20, 1])
    turns = "".join(clock.log)[-2 * (10 + 2 + 1) :]
    assert turns == 2 * (10 * "a" + 2 * "b" + "c")


@pytest.mark.parametrize(("slow_call", "repeats"), [(1, 1), (5, 5)])
def test_neither_a_first_call_that_compiles_nor_one_slow_turn_changes_a_rate(slow_call, repeats):
    job = Clock().job("a", lambda call: 60.0 if call == slow_call else 0.01)
    assert rates([job], Effort(repeats=repeats, seconds=0.01)) == pytest.approx([100])


def test_a_job_too_short_for_the_clock_has_a_finite_rate():
    (rate,) = rates([Clock().job("a", 0.0)], Effort(repeats=1, seconds=0))
    assert 0 < rate < float("inf")


def lasting(seconds):
    """A side whose every call takes so long, by its own clock."""
    return Side("they", lambda: Clock().job("they", seconds))


def figure(unit, other=None, target=None, ours=0.5):
    other = other or lasting(0.25)
    return Figure(name="f", what="w", unit=unit, ours=lasting(ours), other=other, target=target)


@pytest.mark.parametrize(
    ("unit", "ours", "verdict"),
    [
        ("steps/s", 0.125, "yes"),
        ("steps/s", 0.5, "missed"),
        ("ms/trial", 0.5, "yes"),
        ("ms/trial", 0.75, "missed"),
    ],
)
def test_a_target_is_a_least_ratio_of_rates_but_a_largest_of_times(unit, ours, verdict):
    row = measured(figure(unit, target=2, ours=ours), ONCE)
    assert row.verdict == verdict
    assert replace(row, figure=figure(unit)).verdict == ""


def test_a_rate_is_per_second_and_a_time_in_its_unit():
    rate, time = measured(figure("steps/s"), ONCE), measured(figure("ms/trial"), ONCE)
    assert (rate.ours, rate.other, rate.ratio) == (2.0, 4.0, 0.5)
    assert (time.ours, time.other, time.ratio) == (500.0, 250.0, 2.0)


def test_what_another_machine_did_stands_beside_ours_without_a_ratio():
    row = measured(figure("µs/step", Published("they", 383.0)), ONCE)
    assert (row.ours, row.other) == (500_000.0, 383.0)
    assert math.isnan(row.ratio)


def test_docs_explain_every_figure():
    words = DOCS.read_text()
    # of rows that stand for two figures
    words += "".join(f"`replanned_fresh_vs_map_step{n}k`" for n in (1, 10))
    assert [f.name for f in (*FIGURES, *PEERS) if f"`{f.name}`" not in words] == []


def test_the_plan_of_the_replanned_lap_is_new_at_every_step():
    lap = replanned_lap()
    plans = [lap.first, *(plan for _, _, plan in lap.steps)]
    pairs = list(pairwise(plan for plan in plans if len(plan) > 1))
    assert len(pairs) > 100
    changed = [not np.array_equal(old[1:][: len(new)], new[: len(old) - 1]) for old, new in pairs]
    assert np.mean(changed) > 0.95
    assert all((plan[0] == step[1]).all() for plan, step in zip(plans, lap.steps, strict=False))


def test_a_trial_is_what_more_worlds_add_to_a_sweep_and_a_share_its_localizers_median(monkeypatch):
    # starting a sweep takes 9 s, a trial 0.5, its localizer 0.25
    monkeypatch.setattr(worlds, "_seconds_of_sweep", lambda name, n: (9 + 0.5 * n, 0.25))
    both = [worlds.trial_job("mcl", localizer_only=only) for only in (False, True)]
    assert rates(both, ONCE) == [2.0, 4.0]


def test_all_beams_of_one_scan_are_clipped_and_none_of_the_other(monkeypatch):
    seen = []

    class Scan:
        def __init__(self, **_):
            self.log_likelihood = lambda _, scan: seen.append(scan.ranges)

    monkeypatch.setattr(steps, "LidarScan", Scan)
    for clipped in (True, False):
        steps.scan_job(clipped=clipped).call()
    every, none = seen
    assert (every == fan(16).max_range).all()
    assert ((none > 0) & (none < fan(16).max_range)).all()


class Rooms:
    """A vector env of two rooms, whose episodes last 3 and 5 steps; notes what they are told."""

    num_envs = 2

    def reset(self, *, seed):
        self.step_of, self.told = np.zeros(2, int), []
        self.over = np.zeros(2, bool)

    def step(self, actions):
        self.told.append(actions.tolist())
        self.step_of = np.where(self.over, 0, self.step_of + 1)
        self.over = self.step_of == (3, 5)
        return None, None, self.over, np.zeros(2, bool), {}


def test_every_room_is_driven_by_the_steps_since_its_own_episode_began():
    rooms = Rooms()
    job = worlds.driving_all(rooms, np.array([10, 11, 12, 13, 14, 15, 16]))
    for _ in range(10):
        job.call()
    first, second = np.array(rooms.told).T.tolist()
    # the action after an episode's end only resets: it may be any
    assert first[:3] + first[4:7] == [10, 11, 12] * 2
    assert second[:5] + second[6:10] == [10, 11, 12, 13, 14, 10, 11, 12, 13]
    assert job.amount == 2


def test_a_single_env_is_driven_along_its_plan():
    env = gym.make(worlds.ROOM)
    _, info = env.reset(seed=0)
    planned = np.array(info["planned_actions"])
    told, step = [], env.step
    env.step = lambda action: (told.append(action.tolist()), step(action))[1]
    job = worlds.driving(env, planned)
    for _ in range(150):
        job.call()
    assert told == planned[:150].tolist()


BOUNDS = {  # of ratios within one process, never a time; far below what we aim at
    "rays_vs_numpy": 3.0,
    "rays_vs_pymunk": 200.0,
    "step1k_vs_numpy": 1.5,
    "deq_vs_map_step": 2.0,
    "deq_lag80_vs_lag10": 1.6,
    "vector64_vs_cartpole_vector64": 0.4,
}


@pytest.mark.slow
@pytest.mark.parametrize("figure", [f for f in FIGURES if f.name in BOUNDS], ids=lambda f: f.name)
def test_we_do_not_fall_far_behind(figure):
    ratio = measured(figure, Effort(repeats=9, seconds=0.05)).ratio
    bound = BOUNDS[figure.name]
    assert ratio < bound if is_time(figure.unit) else ratio > bound
