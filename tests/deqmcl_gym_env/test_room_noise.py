"""Noise as documented; what a seed starts; sources never disturb each other."""

import math

import numpy as np
from room_cases import calm, drive, wrapped

from deqmcl_gym.envs import RoomEnv


def episode(env: RoomEnv, seed: int | None, steps: int = 30) -> np.ndarray:
    """Truths and first ranges of the plan's first steps, (steps + 1, 4)."""
    scan, info = env.reset(seed=seed)
    rows = [[*info["truth"], scan[0]]]
    rows += [[*said[4]["truth"], said[0][0]] for said in drive(env, env.plan[:steps])]
    return np.array(rows)


def test_the_first_reset_may_come_without_a_seed():
    env = RoomEnv(preset="matched")
    first = episode(env, None)
    np.testing.assert_array_equal(episode(env, env.np_random_seed), first)


def test_a_generator_that_was_set_draws_the_seeds():
    scans = []
    for _ in range(2):
        env = RoomEnv(preset="matched")
        env.np_random = np.random.default_rng(3)
        scans.append([episode(env, None), episode(env, None)])
    np.testing.assert_array_equal(scans[0], scans[1])
    assert (scans[0][0] != scans[0][1]).any()


def test_streams_are_those_of_the_documented_seed_sequence():
    seed, number = 21, 1  # the second episode after seeding
    keys = ((number, stream) for stream in range(3))
    seeds = (np.random.SeedSequence(seed, spawn_key=key) for key in keys)
    motion, sensor, start = map(np.random.default_rng, seeds)
    env = RoomEnv(
        lidar={"beams": 2, "sigma": 2.0},
        noise={"drive": 0.1, "turn": 0.05, "drift": 0.01},
        start={"sd_position": 4.0, "sd_heading": 0.2},
        lap={"step": 2.0},  # for more than 300 steps
    )
    env.reset(seed=seed)
    scan, info = env.reset()
    x, y, heading = np.array([175, 50, 0]) + np.array([4.0, 4.0, 0.2]) * start.standard_normal(3)
    noise = env.world.noise
    for turn in (0.0, 0.25, -0.5) * 100:  # exact in float32
        # float64 sums of numbers below 400, 300 of them: some hundred of their ulps (6e-14)
        np.testing.assert_allclose(info["truth"][:2], (x, y), rtol=0, atol=1e-10)
        assert abs(wrapped(info["truth"][2] - heading)) < 1e-10
        # float32 ranges below 512 px: half an ulp is 1.5e-5; noise of σ = 2 leaves [0, 400] never
        exact = env.floor_plan.ranges([env.pose], env.lidar.bearings)[0]
        np.testing.assert_allclose(scan - exact, 2 * sensor.standard_normal(2), rtol=0, atol=5e-5)
        first, second = motion.standard_normal(2)
        heading += turn + (noise.turn * abs(turn) + noise.drift * 0.5) * second
        way = 0.5 * (1 + noise.drive * first)
        x, y = x + way * np.cos(heading), y + way * np.sin(heading)
        scan, *_, info = env.step(np.float32([0.5, turn]))


def test_scans_have_the_noise_and_the_atoms_of_clipping():
    # Standing still 175 px before a wall; r = σ and max = 2.5 σ, so the atoms are P(o = 0) = Φ(-1)
    # and P(o = max) = 1 - Φ(1.5). Every share at 5 standard errors: false alarms 6e-7 each.
    sigma = 175.0
    lidar = {"beams": 50, "field_of_view": 1e-6, "sigma": sigma, "max_range": 2.5 * sigma}
    env = calm(lidar=lidar, ends_at_goal=False)
    scans = np.array([said[0] for said in drive(env, np.zeros((200, 2)))])
    most, shares = 2.5 * sigma, (0.15866, 0.06681, 0.5)
    for seen, share in zip((scans == 0, scans == most, scans < sigma), shares, strict=True):
        assert abs(seen.mean() - share) < 5 * math.sqrt(share * (1 - share) / scans.size)


def test_a_start_that_would_touch_a_wall_is_drawn_again():
    env = calm(start={"pose": (20, 20, 0.0), "sd_position": 10.0})
    starts = np.array([env.reset()[1]["truth"] for _ in range(500)])
    # Without redrawing, Φ(-1.2) = 11.5 % of each of x and y would lie below the radius.
    assert starts[:, :2].min() > 8.0
    # They come up to the wall: 2.3 % of each lie between 8 and 9, and 0.977^1000 < 1e-10.
    assert starts[:, :2].min() < 9.0
