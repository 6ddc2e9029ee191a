"""What the formulas of the noise say of special cases; test_room_reproducible has them exactly."""

import math

import numpy as np
import reference
from room_cases import STILL, calm, drive, wide


def test_a_turn_on_the_spot_moves_nothing_and_standing_still_turns_nothing():
    env = wide(noise={"drive": 0.1, "turn": 0.2, "drift": 0.01})
    _, info = env.reset(seed=1)
    start = info["truth"]
    turned = drive(env, [(0, 0.5)])[0][4]["truth"]
    np.testing.assert_array_equal(turned[:2], start[:2])
    assert turned[2] != 0.5  # the noise of the turn
    still = drive(env, [(0, 0)] * 50)[-1][4]["truth"]
    np.testing.assert_array_equal(still[:2], start[:2])
    assert abs(still[2] - turned[2]) < 1e-13  # wrapping may round: 50 half ulps of 2π


def test_without_sensor_noise_a_scan_is_the_exact_ranges_clipped():
    bearings = np.linspace(-math.pi / 4, math.pi / 4, 9)
    env = calm(lidar={"beams": 9, "sigma": 0.0, "max_range": 90.0}, ends_at_goal=False)
    said = drive(env, env.plan)
    poses = np.array([step[4]["truth"] for step in said])
    scans = np.array([step[0] for step in said], dtype=float)
    # A float32 ray is the exact ray of some pose within 1e-3 px and 1e-5 rad; beside a corner
    # that may be on either wall, so the scan has to lie between the extremes of such poses.
    shifts = [(dx, dy, dh) for dx in (0, 1e-3, -1e-3) for dy in (0, 1e-3, -1e-3)
              for dh in (0, 1e-5, -1e-5)]  # fmt: skip
    exact = np.array(
        [reference.ranges(env.floor_plan.walls, poses + shift, bearings) for shift in shifts]
    )
    low, high = exact.min(axis=0).clip(max=90.0), exact.max(axis=0).clip(max=90.0)
    assert ((scans >= low - 1e-3) & (scans <= high + 1e-3)).all()
    assert np.median(high - low) < 0.01  # the bracket is tight
    assert 0.1 < (scans == 90.0).mean() < 0.9  # clipped and unclipped ranges both occur


def test_scans_have_the_noise_and_the_atoms_of_clipping():
    """Every share at 5 standard errors: false alarms 6e-7 each, for a fresh seed."""
    # Standing still 20,000 px before a wall; r = σ and max = 2.5 σ, so the atoms are
    # P(o = 0) = Φ(-1) and P(o = max) = 1 - Φ(1.5); half of all lie below r, Φ(1) - Φ(0.5) of all
    # between r + σ/2 and r + σ.
    count, r = 10_000, 20_000.0
    sigma = r
    env = wide(noise=STILL, lidar={"sigma": sigma, "max_range": 2.5 * sigma})
    env.reset(seed=3)
    scans = np.array([env.step(np.zeros(2, np.float32))[0][0] for _ in range(count)])

    def phi(z: float) -> float:
        return (1 + math.erf(z / math.sqrt(2))) / 2

    for seen, share in (
        (scans == 0, phi(-1)),
        (scans == np.float32(2.5 * sigma), 1 - phi(1.5)),
        (scans < r, 0.5),
        ((scans > r + sigma / 2) & (scans < r + sigma), phi(1) - phi(0.5)),
    ):
        assert abs(seen.mean() - share) < 5 * math.sqrt(share * (1 - share) / count)


def test_a_start_that_would_touch_a_wall_is_drawn_again():
    env = calm(start={"pose": (20, 20, 0.0), "sd_position": 10.0})
    starts = np.array([env.reset()[1]["truth"] for _ in range(500)])
    # Without redrawing, Φ(-1.2) = 11.5 % of each of x and y would lie below the radius.
    assert starts[:, :2].min() > 8.0
    # They come up to the wall: 2.3 % of each lie between 8 and 9, and 0.977^1000 < 1e-10.
    assert starts[:, :2].min() < 9.0
