"""Wrappers: a jump, lost beams, a changed plan and everything else as it was; a curriculum."""

import math

import gymnasium as gym
import numpy as np
import pytest
import reference
from gymnasium.envs.registration import EnvSpec
from refusals import refused
from room_cases import ROOM_ID, SEVERAL, WRAPPED, calm, drive, poses_of, wrapped

import deqmcl_gym  # noqa: F401  # registers the environments
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.wrappers import BeamDropout, Curriculum, Kidnap, PlanChange
from deqmcl_gym.validation import InputError

ELSEWHERE = (60.0, 200.0, 1.0)
BEAMS = {"lidar": {"beams": 100, "sigma": 5.0}}
NEW = np.float32([(1, 0.1), (2, -0.1), (3, 0.0)])
SIZE = gym.spaces.Box(0, 1, (1,), np.float32)


def kidnapped(step: int, pose=None, **kwargs) -> Kidnap:
    return Kidnap(RoomEnv(ends_at_goal=False, **kwargs), step=step, pose=pose)


@pytest.mark.parametrize("step", [1, 4, 204])
def test_the_robot_takes_the_given_step_of_each_episode_from_the_given_pose(step):
    env = Kidnap(calm(ends_at_goal=False), step=step, pose=ELSEWHERE)
    x, y, heading = ELSEWHERE
    for _ in range(2):
        env.reset()
        poses = poses_of(env, [*np.zeros((step - 1, 2)), (5, 0)])
        np.testing.assert_array_equal(poses[:-1], [(175, 50, 0)] * (step - 1) or np.empty((0, 3)))
        expected = (x + 5 * math.cos(heading), y + 5 * math.sin(heading), heading)
        np.testing.assert_allclose(poses[-1], expected, rtol=0, atol=1e-10)  # float64 below 1000


@pytest.mark.parametrize("pose", [ELSEWHERE, None])
def test_noise_and_everything_told_but_the_truth_stay_those_of_the_unkidnapped_robot(pose):
    # With seed 3 the random pose has room ahead for the 15 steps, too: "collided" agrees.
    slow = {"lap": {"step": 1.0}}
    usual, taken = RoomEnv(ends_at_goal=False, **slow), kidnapped(10, pose, **slow)
    mine, theirs = ([env.reset(seed=3)[1]] for env in (usual, taken))
    for action in usual.plan[:25]:
        mine.append(usual.step(action)[4])
        theirs.append(taken.step(action)[4])
    for key in ("planned_actions", "planned_count", "command", "collided"):
        np.testing.assert_array_equal(*([info[key] for info in told] for told in (mine, theirs)))
    truths, elsewhere = (np.array([info["truth"] for info in told]) for told in (mine, theirs))
    np.testing.assert_array_equal(truths[:10], elsewhere[:10])
    # From there on both turn and drive with the same errors, each in its own direction;
    # float64 numbers below 400 are exact to 6e-14.
    turns = [wrapped(np.diff(poses[10:, 2])) for poses in (truths, elsewhere)]
    ways = [np.hypot(*np.diff(poses[10:, :2], axis=0).T) for poses in (truths, elsewhere)]
    np.testing.assert_allclose(*turns, rtol=0, atol=1e-12)
    np.testing.assert_allclose(*ways, rtol=0, atol=1e-12)


def test_random_poses_are_free_and_all_over_the_floor():
    env = kidnapped(1, floor_plan=SEVERAL)
    walls, poses = env.unwrapped.floor_plan.walls, []
    for episode in range(300):
        env.reset(seed=1 if episode == 0 else None)
        poses.append(env.step(np.zeros(2, np.float32))[4]["truth"])
    poses = np.array(poses)
    assert reference.clearance(walls, poses, poses).min() > 8.0 - 1e-4  # decided in float32
    assert (reference.winding(walls, poses) == 1).all()
    # Each quarter of the box has over 10 % of the free space, each quarter turn 25 % of the
    # headings: P(fewer than 8 of 300) is below 1e-6.
    quarters = (poses[:, 0] > 250) + 2 * (poses[:, 1] > 200)
    assert np.bincount(quarters, minlength=4).min() >= 8
    assert np.bincount(((poses[:, 2] + math.pi) // (math.pi / 2)).astype(int)).min() >= 8


def kidnapped_twice(seed: int, below) -> list[np.ndarray]:
    env = Kidnap(below(RoomEnv(ends_at_goal=False)), step=3)
    env.reset(seed=seed)
    return list(poses_of(env, np.zeros((3, 2))))


def test_two_random_kidnaps_draw_poses_of_their_own_and_fixed_ones_none():
    _, once = kidnapped_twice(1, lambda env: env)[1:]
    _, first, second = kidnapped_twice(1, lambda env: Kidnap(env, step=2))
    np.testing.assert_array_equal(first, once)  # the inner one draws what it would draw alone
    assert abs(second - first).max() > 1
    _, fixed, random = kidnapped_twice(1, lambda env: Kidnap(env, step=2, pose=ELSEWHERE))
    np.testing.assert_allclose(fixed, ELSEWHERE, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(random, once)


def episode(env, seed: int = 5) -> tuple[np.ndarray, list]:
    """All scans of the plan's first 200 steps, (201, 100), and all else that was said."""
    scan, info = env.reset(seed=seed)
    said = drive(env, env.unwrapped.plan[:200])
    scans = np.array([scan, *(step[0] for step in said)])
    return scans, [info, *(step[1:] for step in said)]


@pytest.mark.parametrize("probability", [0.02, 0.5, 0.9])
def test_beams_are_lost_with_the_probability_whatever_neighbours_or_scans_lose(probability):
    scans, _ = episode(BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), probability))
    lost = np.isposinf(scans)
    pairs = lost[:, 1:] & lost[:, :-1], lost[1:] & lost[:-1]
    for seen, share in ((lost, probability), *((pair, probability**2) for pair in pairs)):
        # 5 standard errors of a binomial share, false alarms 6e-7 each; a pair shares beams with
        # two others: at most √2 times the error
        assert abs(seen.mean() - share) < 5 * math.sqrt(2 * share * (1 - share) / seen.size)


def test_beams_that_are_not_lost_and_all_else_are_those_of_the_bare_env():
    bare, bare_rest = episode(RoomEnv(preset="matched", ends_at_goal=False, **BEAMS))
    env = RoomEnv(preset="matched", ends_at_goal=False, **BEAMS)
    thinned, rest = episode(BeamDropout(env, 0.3))
    kept = np.isfinite(thinned)
    np.testing.assert_array_equal(thinned[kept], bare[kept])
    np.testing.assert_equal(rest, bare_rest)


@pytest.mark.parametrize("probability", [0, 1])
def test_probability_0_loses_nothing_and_1_everything(probability):
    bare, _ = episode(RoomEnv(ends_at_goal=False, **BEAMS))
    scans, _ = episode(BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), probability))
    np.testing.assert_array_equal(scans, bare if probability == 0 else np.inf)


def test_what_is_lost_follows_from_the_seed_and_the_episode():
    env = BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), 0.5)
    first, _ = episode(env, seed=5)
    second, _ = episode(env, seed=None)
    again, _ = episode(env, seed=5)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(np.isinf(first), np.isinf(second))


def changed(step: int, actions, **kwargs) -> PlanChange:
    return PlanChange(RoomEnv(ends_at_goal=False, **kwargs), step=step, actions=actions)


@pytest.mark.parametrize("count", [0, 3, 300])
@pytest.mark.parametrize("horizon", [5, None])
def test_the_new_plan_is_shown_after_its_step_and_the_episode_ends_with_it(count, horizon):
    new = np.tile(NEW, (100, 1))[:count]
    env = changed(3, new, horizon=horizon)
    old, rows = env.unwrapped.plan.copy(), horizon or 204
    for _ in range(2):  # reset brings the old plan back
        _, info = env.reset(seed=0)
        said = drive(env, np.zeros((3 + count, 2)))
        for step, told in enumerate([info, *(step[4] for step in said)]):
            left = (old[step:] if step < 3 else new[step - 3 :])[:rows]
            assert told["planned_count"] == len(left)
            expected = np.vstack([left, np.zeros((rows - len(left), 2), np.float32)])
            np.testing.assert_array_equal(told["planned_actions"], expected)
        assert not any(step[2] for step in said)
        assert [step[3] for step in said] == [False] * (2 + count) + [True]


def test_the_world_moves_and_senses_as_without_the_change():
    bare, other = RoomEnv(ends_at_goal=False), changed(5, np.tile(NEW, (20, 1)))
    actions = bare.plan[:30]
    for env in (bare, other):
        env.reset(seed=4)
    for one, two in zip(drive(bare, actions), drive(other, actions), strict=True):
        assert one[1:4] == two[1:4]
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[4]["truth"], two[4]["truth"])


@pytest.mark.parametrize(
    "actions", [[[1.0, 0.0, 0.0]], [[np.nan, 0.0]], None, [(1.0, 0.0), (10.5, 0.0)]]
)
def test_what_is_no_plan_is_refused_at_once_and_nothing_has_happened(actions):
    with pytest.raises(InputError, match=r"actions|must be two numbers"):
        changed(3, actions)
    env = RoomEnv(ends_at_goal=False)
    env.reset(seed=0)
    plan = env.plan
    with pytest.raises(InputError):
        env.replace_plan(actions)
    np.testing.assert_array_equal(env.plan, plan)


def test_stacked_wrappers_all_act():
    env = WRAPPED["all"](gym.make(ROOM_ID, lidar={"beams": 50}))
    bare = gym.make(ROOM_ID, lidar={"beams": 50})
    assert 5 < np.isinf(env.reset(seed=1)[0]).sum() < 45  # P < 1e-8 outside, p = 0.5
    bare.reset(seed=1)
    still = np.zeros(2, np.float32)
    jumps, counts = [], []
    for _ in range(3):
        info, other = env.step(still)[4], bare.step(still)[4]
        jumps.append(bool((info["truth"] != other["truth"]).any()))
        counts.append(info["planned_count"])
    assert jumps == [False, True, True]
    assert counts == [203, 202, 10]


class Task(gym.Env):
    """Ends after a step, done if the action is 1; shows a random number."""

    observation_space, action_space = SIZE, SIZE

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._seen(), {}

    def step(self, action):
        return self._seen(), 0.0, True, False, {"is_success": bool(action[0] == 1)}

    def _seen(self):
        return self.np_random.random(1, np.float32)


def stages(env, successes, seed=0):
    """The stage of each episode, and what is seen at its start."""
    found = []
    for number, success in enumerate(successes):
        seen, info = env.reset(seed=seed if number == 0 else None)
        found.append((info["stage"], float(seen[0])))
        *_, told = env.step(np.array([success], np.float32))
        assert told["stage"] == info["stage"]
    return found


def test_it_goes_on_when_enough_of_the_last_episodes_of_a_stage_were_done():
    env = Curriculum([Task(), Task(), Task()], success=0.5, window=4)
    done = [0, 0, 1, 0, 1, 1, 0, 1, 1, 0, 0, 0, 0]
    # after five episodes two of the last four were done; counting starts again at stage 1
    assert [stage for stage, _ in stages(env, done)] == [0] * 5 + [1] * 4 + [2] * 4


def test_the_first_seed_determines_the_episodes_of_all_stages():
    one, same = (stages(Curriculum([Task(), Task()], window=2), [1] * 6, seed=5) for _ in "ab")
    other = stages(Curriculum([Task(), Task()], window=2), [1] * 6, seed=6)
    assert one == same
    assert not {seen for _, seen in one} & {seen for _, seen in other}


def test_an_env_that_does_not_tell_success_is_done_by_termination():
    env = Curriculum([gym.make("deqmcl_gym/Sharp-v0", max_episode_steps=1) for _ in range(2)],
                     success=0.0, window=1)  # fmt: skip
    _, info = env.reset(seed=0)
    *_, truncated, info = env.step(info["planned_actions"][0])
    assert truncated
    assert env.reset()[1]["stage"] == 1
    strict = Curriculum(env._envs, success=0.1, window=1)
    _, info = strict.reset(seed=0)
    strict.step(info["planned_actions"][0])
    assert strict.reset()[1]["stage"] == 0
    env.close()


def test_stages_of_other_spaces_none_at_all_and_bad_thresholds_are_refused():
    few, many = (gym.make("deqmcl_gym/Sharp-v0", lidar={"beams": beams}) for beams in (3, 9))
    with refused("stage 1 has the observation_space", "stage 0"):
        Curriculum([few, many])
    with refused("envs is empty"):
        Curriculum([])
    for name, value in (("success", 1.5), ("window", 0)):
        with refused(name):
            Curriculum([Task()], **{name: value})


def test_seeded_actions_are_the_same_in_every_run_and_observations_within_one_space():
    def drawn():
        made = [Task(), Task()]
        made[1].action_space = gym.spaces.Box(0, 1, (1,), np.float32)
        made[1].observation_space = gym.spaces.Box(-2, 0.5, (1,), np.float32)
        env = Curriculum(made, success=0.0, window=1)
        env.action_space.seed(1)
        actions = []
        for _ in range(3):
            assert env.reset(seed=0)[0] in env.observation_space
            actions.append(float(env.action_space.sample()[0]))
            env.step(np.float32([0.0]))
        assert env.observation_space == gym.spaces.Box(-2, 1, (1,), np.float32)
        return actions

    assert drawn() == drawn()


def test_a_spec_makes_the_same_stages_again_also_by_json():
    stages = [gym.make("deqmcl_gym/Sharp-v0", max_episode_steps=most) for most in (2, 3)]
    env = Curriculum(stages, success=0.0, window=1)
    assert env.spec.max_episode_steps == 3
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec, render_mode="rgb_array")
        for seed in (4, None):
            np.testing.assert_equal(again.reset(seed=seed), env.reset(seed=seed))
            while not env.step(np.float32([1, 0]))[3]:
                assert not again.step(np.float32([1, 0]))[3]
            assert again.step(np.float32([1, 0]))[3]
        assert again.render().ndim == 3
        env = Curriculum(stages, success=0.0, window=1)
    assert Curriculum([Task()]).spec is None
