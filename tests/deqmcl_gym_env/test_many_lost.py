"""Many compiled ``Localize-v0`` are the single env, side by side, step by step."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from refusals import refused

import deqmcl_gym  # noqa: F401
from localizers.many import LocalizeVectorEnv
from localizers.models.prior import random_poses
from localizers.models.range_table import RangeTable
from localizers.models.scan import CensoredGaussianUniform, LidarScan, Scan

ID = "deqmcl_gym/Localize-v0"
TASK = {
    "scan": "table",
    "localizer": {"name": "mcl", "particles": 300},
    "floor_plan": {"office": {"wings": 1, "corridors": 1, "seeds": [20, 60]}},
    "share": 0.3,
    "hold": 3,
    "max_steps": 25,
    "particles": 4,
    "cell": 2.0,
}
ROOMS = 5
SQUARE = {"outer": [[0, 0], [9, 0], [9, 9], [0, 9]], "unit": "m"}
FEW = {"name": "mcl", "particles": 50}


def actions(rng, seen):
    """Drives on, into walls too; declares now and then, when it is confident."""
    move = rng.uniform([0.1, -0.6], [0.2, 0.6], (ROOMS, 2))
    declared = (seen["confident"][:, 0] >= 1.0) & (rng.random(ROOMS) < 0.2)
    return np.hstack([move, declared[:, None]]).astype(np.float32)


def agree(many, single):
    for name, value in single.items():
        np.testing.assert_allclose(many[name], value, rtol=0, atol=1e-4, err_msg=name)


def test_rooms_are_the_single_env_through_contacts_declarations_and_new_buildings():
    envs = gym.make_vec(ID, num_envs=ROOMS, **TASK)
    assert isinstance(envs, LocalizeVectorEnv)
    singles = [gym.make(ID, **TASK) for _ in range(ROOMS)]
    seen, info = envs.reset(seed=7)
    for room, single in enumerate(singles):
        own, told = single.reset(seed=7 + room)
        agree({name: value[room] for name, value in seen.items()}, own)
        agree({name: value[room] for name, value in info.items()}, told)
    rng, ended = np.random.default_rng(0), np.zeros(ROOMS, bool)
    ends, contacts, right = 0, 0, 0
    for _ in range(120):
        chosen = actions(rng, seen)
        seen, rewards, terminated, truncated, info = envs.step(chosen)
        assert envs.observation_space.contains(seen)
        for room, single in enumerate(singles):
            if ended[room]:
                own, told = single.reset()
                paid = 0.0, False, False
            else:
                own, *paid, told = single.step(chosen[room])
            assert (rewards[room], terminated[room], truncated[room]) == tuple(paid)
            agree({name: value[room] for name, value in seen.items()}, own)
            agree({name: value[room] for name, value in info.items()}, told)
        ended = terminated | truncated
        ends += int(ended.sum())
        contacts += int(info["collided"].sum())
        right += int(info["is_success"].sum())
    assert ends > 20
    assert contacts > 20
    assert right > 0


def test_with_same_step_the_last_observation_is_told_and_the_next_episode_is_seen():
    modes, how = (AutoresetMode.NEXT_STEP, "SameStep"), {"num_envs": ROOMS, **TASK}
    ways = {mode: gym.make_vec(ID, autoreset_mode=mode, **how) for mode in modes}
    still = np.zeros((ROOMS, 3), np.float32)
    steps = {}
    for mode, envs in ways.items():
        envs.reset(seed=3)
        steps[mode] = [envs.step(still) for _ in range(TASK["max_steps"] + 1)]
    next_step, same_step = steps.values()
    last, _, _, truncated, info = same_step[-2]
    assert truncated.all()
    for room in range(ROOMS):
        agree(info["final_obs"][room], {k: v[room] for k, v in next_step[-2][0].items()})
    agree(last, next_step[-1][0])  # of the next episode
    assert (info["final_info"]["truth"] == next_step[-2][4]["truth"]).all()


def test_disabled_rooms_wait_for_their_reset():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", **TASK)
    envs.reset(seed=0)
    declared = np.float32([[0, 0, 1], [0, 0, 0]])
    envs.step(declared)
    with pytest.raises(RuntimeError, match="the episode in room 0 has ended"):
        envs.step(declared)
    seen, _ = envs.reset(options={"reset_mask": np.array([True, False])})
    assert seen["clock"].ravel().tolist() == [0.0, np.float32(1 / TASK["max_steps"])]


def test_rooms_go_on_the_same_after_pickling_and_on_one_thread():
    envs = gym.make_vec(ID, num_envs=ROOMS, **TASK)
    rng = np.random.default_rng(1)
    seen, _ = envs.reset(seed=1)
    seen, *_ = envs.step(actions(rng, seen))
    copy = pickle.loads(pickle.dumps(envs))
    copy._threads = 1
    for _ in range(30):
        chosen = actions(rng, seen)
        seen, other = envs.step(chosen)[0], copy.step(chosen)[0]
        assert all((seen[name] == other[name]).all() for name in seen)
    envs.close()
    copy.close()


@pytest.mark.parametrize(
    "task",
    [
        {},
        {"scan": "table"},
        {"localizer": FEW},
        {"scan": "table", "localizer": FEW, "floor_plan": SQUARE},
        {"scan": "table", "localizer": FEW, "lidar": {"min_range": 0.2}},
    ],
)
def test_what_is_not_compiled_runs_one_by_one(task):
    envs = gym.make_vec(ID, num_envs=2, **task)
    assert isinstance(envs, gym.vector.SyncVectorEnv)
    assert envs.num_envs == 2


def test_a_table_weighs_scans_as_ray_casts_from_the_cells_centre_do():
    env = gym.make(ID, localizer={"name": "mcl", "particles": 10}).unwrapped
    env.reset(seed=0)
    lidar, plan, cell = env.lidar, env.floor_plan, 0.2
    beam = CensoredGaussianUniform(sigma=0.5, power=0.1)
    table = RangeTable(beam=beam, cell=cell).made(plan, lidar)
    x0, y0 = plan.bounds[:2]
    rng = np.random.default_rng(0)
    poses = random_poses(plan, 400, rng, 0.2)  # 0.2 m from walls: each cell's centre is free
    corner = np.array([[x0], [y0]])
    centres = np.floor((poses[:2] - corner) / cell) * cell + cell / 2 + corner
    direction = 2 * np.pi / 64
    headings = direction * rng.integers(64, size=400)
    turned = headings + rng.uniform(-0.49, 0.49, 400) * direction
    exact = np.vstack([centres, headings]).astype(np.float32)
    looked_up = np.vstack([poses[:2], turned]).astype(np.float32)
    ranges = np.append(rng.uniform(0.5, 11.9, lidar.beams - 2), [0.0, lidar.max_range])
    scan = Scan.of(ranges, lidar.max_range)
    wanted = LidarScan(floor_plan=plan, lidar=lidar, beam=beam).log_likelihood(exact, scan)
    off = np.abs(table.log_likelihood(looked_up, scan) - wanted)
    # A code is a step of 0.059 m, both ranges are off by at most half of one. The slope of log p is
    # at most 3.0/σ, at an end of the range (2.3/σ inside, where the uniform share takes over).
    assert off.max() < 0.1 * lidar.beams * 3.0 / 0.5 * 0.06


def test_bad_actions_are_refused_and_no_room_moves():
    envs = gym.make_vec(ID, num_envs=2, **TASK)
    with pytest.raises(RuntimeError, match="has not begun"):
        envs.step(np.zeros((2, 3), np.float32))
    envs.reset(seed=0)
    before = envs._robots.poses.copy()
    with refused("in room 1, the action is"):
        envs.step(np.float32([[0.1, 0, 0], [9, 0, 0]]))
    with refused("num_envs is 0"):
        gym.make_vec(ID, num_envs=0, **TASK)
    with refused("must be numbers of shape (2, 3)"):
        envs.step(np.zeros((2, 2), np.float32))
    assert (envs._robots.poses == before).all()
