"""What is compared: the sides do the same, and aims are read the right way round."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import reference

from benchmarks.speed import rays, scaling, trials, worlds
from benchmarks.speed.command import FIGURES
from benchmarks.speed.figure import (
    MICROSECONDS,
    Figure,
    Measured,
    UnavailableError,
    in_unit,
    measured,
)
from benchmarks.speed.lap import free_poses
from benchmarks.speed.tables import terminal_table
from benchmarks.speed.timing import Effort, Job
from deqmcl_gym.world.paper_room import PAPER_ROOM

PROMISED = {  # and their targets
    "rays_vs_numpy": 8,
    "rays_vs_numpy_slabs": None,
    "rays_vs_pymunk": 1000,
    "rays_vs_navground": 10,
    "rays_vs_navground_16": None,
    "rays_vs_raycast2d": None,
    "step1k_vs_numpy": 10,
    "step1k_vs_numpy_slabs": None,
    "step10k_vs_numpy": 5,
    "step10k_vs_numpy_slabs": None,
    "step1k_vs_particles": 10,
    "step1k_vs_pfilter": 10,
    "step1k_vs_stonesoup": 10,
    "deq_vs_map_step": 1.5,
    "deq_lag80_vs_lag10": 1.3,
    "trial_mcl": 2,
    "trial_deq_mcl": 2,
    "censored_vs_inside_1": 1.5,
    "censored_vs_inside_16": 1.5,
    "amcl_step": 1,
    "env_vs_cartpole": 0.5,
    "vector64_vs_cartpole_vector64": 1.2,
    "vector1024_vs_cartpole_vector1024": None,
    "vector1024_vs_single": None,
}


def figure(unit="rays/s", target=None):
    def sides():
        return Job(call=int), Job(call=int)

    return Figure(name="f", task="t", ours="o", other="p", unit=unit, sides=sides, target=target)


def test_all_promised_figures_are_there_with_their_targets():
    assert {f.name: f.target for f in FIGURES} == PROMISED


def test_what_others_say_of_theirs_stands_beside_ours():
    said = replace(figure(MICROSECONDS, target=1), sides=lambda: (Job(call=int), 5e6))
    row = measured(said, Effort(repeats=1, seconds=0.0))
    assert (row.other, row.reached) == (5e6, True)
    assert "MISSED" in terminal_table([replace(row, ours=6e6)])
    assert "MISSED" not in terminal_table([row])


def test_a_trial_is_one_that_succeeds_and_its_localizer_sees_as_many_steps():
    whole, alone = trials.trial_sides("mcl")
    assert whole.call().reason is None
    assert whole.amount == alone.amount > 100


@pytest.mark.parametrize(
    ("unit", "ratio", "reached"),
    [("rays/s", 9, True), ("rays/s", 7, False), (MICROSECONDS, 7, True), (MICROSECONDS, 9, False)],
)
def test_a_target_is_a_least_ratio_of_rates_but_a_largest_of_times(unit, ratio, reached):
    row = Measured(figure=figure(unit, target=8), ours=ratio * 3.0, other=3.0)
    assert row.ratio == ratio
    assert row.reached is reached
    assert row.figure.aim == ("≤ 8" if unit == MICROSECONDS else "≥ 8")


def test_a_figure_without_a_target_has_neither_reached_nor_missed_it():
    assert Measured(figure=figure(), ours=1.0, other=2.0).reached is None
    assert figure().aim == ""


def test_a_time_is_a_million_over_the_rate():
    assert in_unit(4.0, MICROSECONDS) == 250_000
    assert in_unit(4.0, "steps/s") == 4.0


def test_pymunk_is_asked_for_the_same_ranges():
    poses, bearings = free_poses(PAPER_ROOM, 200), rays.bearings_of(16)
    seen = rays.pymunk_ranges(rays.pymunk_room(), rays.segments(poses, bearings))
    exact = reference.ranges(PAPER_ROOM.walls, poses, bearings)
    turned = [reference.ranges(PAPER_ROOM.walls, poses, bearings + s * 2e-6) for s in (-1, 1)]
    low, high = np.min([exact, *turned], axis=0), np.max([exact, *turned], axis=0)
    slack = 1e-3  # the ends of rays of 1,000 px, in float32
    apart = np.array(seen).reshape(exact.shape)
    assert ((apart >= low - slack) & (apart <= high + slack)).all()


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
    env = gym.make("deqmcl_gym/Room-v0", **worlds.ROOM)
    _, info = env.reset(seed=0)
    planned = np.array(info["planned_actions"])
    told, step = [], env.step
    env.step = lambda action: (told.append(action.tolist()), step(action))[1]
    job = worlds.driving(env, planned)
    for _ in range(150):
        job.call()
    assert told == planned[:150].tolist()


def test_rooms_without_a_vector_env_cannot_be_measured(monkeypatch):
    spec = gym.spec("deqmcl_gym/Room-v0")
    monkeypatch.setattr(spec, "vector_entry_point", None)
    with pytest.raises(UnavailableError, match="vector_entry_point"):
        worlds.rooms_job(4)


@pytest.mark.skipif(
    gym.spec("deqmcl_gym/Room-v0").vector_entry_point is None, reason="no vector env"
)
def test_rooms_of_a_vector_env_can_be_driven():
    job = worlds.rooms_job(4)
    for _ in range(300):
        job.call()
    assert job.amount == 4


def test_cartpoles_can_be_driven():
    job = worlds.cartpoles_job(4)
    for _ in range(100):
        job.call()
    assert job.amount == 4


@pytest.mark.parametrize("segments", [8, 16, 64, 512])
def test_the_pillared_room_has_as_many_walls_as_asked_for_and_pillars_apart(segments):
    room = scaling.pillared_room(segments)
    assert len(room.walls) == segments
    assert room.free(free_poses(room, 100)).all()
    corners = np.array(room.obstacles).reshape(-1, 2)
    assert ((corners > 0) & (corners < 400)).all()
