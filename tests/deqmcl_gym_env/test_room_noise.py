"""The noise of motion and lidar follows its formulas.

Samples come from one long episode. Every statistic is compared at z = 5 standard errors: a false
alarm has probability 6e-7 per comparison, below 3e-5 for this file, for a fresh seed. The seeds are
fixed, so a test that passes keeps passing until the code changes.
"""

import math

import numpy as np
import pytest
import reference
from room_cases import STILL, calm, drive, wide

Z = 5.0
N = 10_000
NOISE = {"drive": 0.1, "turn": 0.2, "drift": 0.01}


def motion_errors(distance: float, turn: float) -> np.ndarray:
    """(ε_d, ε_φ) of N equal commands, each from the same pose, read off the true poses, (N, 2)."""
    env = wide(noise=NOISE)
    env.reset(seed=1)
    command = np.float32([distance, turn])
    poses = np.empty((N, 3))
    for i in range(N):
        env.place((20_000.0, 20_000.0, 0.0))
        poses[i] = env.step(command)[4]["truth"]
    x, y, heading = (poses - (20_000, 20_000, 0)).T
    return np.column_stack(
        [x * np.cos(heading) + y * np.sin(heading) - distance, heading - float(command[1])]
    )


def check_moments(sample: np.ndarray, sd: float) -> None:
    """Mean, variance and kurtosis of N(0, sd²); their standard errors for n normal samples."""
    n = len(sample)
    assert abs(sample.mean()) < Z * sd / math.sqrt(n)
    assert abs(sample.var() / sd**2 - 1) < Z * math.sqrt(2 / n)
    assert abs((sample**4).mean() / sd**4 - 3) < Z * math.sqrt(96 / n)  # var of z⁴ is 105 - 9


@pytest.mark.parametrize(("distance", "turn"), [(5.0, 0.25), (5.0, -0.25), (8.0, 0.0), (0.0, 0.5)])
def test_motion_noise_has_the_documented_moments(distance, turn):
    drive_error, turn_error = motion_errors(distance, turn).T
    if distance:
        check_moments(drive_error, 0.1 * distance)  # σ_dd |d|
    else:
        assert not drive_error.any()
    check_moments(turn_error, 0.2 * abs(turn) + 0.01 * distance)  # σ_φφ |φ| + σ_φd |d|
    # independent of each other and from step to step: the standard error of a correlation
    pairs = [(turn_error[1:], turn_error[:-1])]
    if distance:
        pairs += [(drive_error, turn_error), (drive_error[1:], drive_error[:-1])]
    for pair in pairs:
        assert abs(np.corrcoef(*pair)[0, 1]) < Z / math.sqrt(N - 1)


def test_a_turn_on_the_spot_moves_nothing_and_standing_still_turns_nothing():
    env = wide(noise=NOISE)
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
    # Standing still 20,000 px before a wall; r = σ and max = 2.5 σ, so the atoms are
    # P(o = 0) = Φ(-1) and P(o = max) = 1 - Φ(1.5); half of all lie below r, Φ(1) - Φ(0.5) of all
    # between r + σ/2 and r + σ.
    r = sigma = 20_000.0
    env = wide(noise=STILL, lidar={"sigma": sigma, "max_range": 2.5 * sigma})
    env.reset(seed=3)
    scans = np.array([env.step(np.zeros(2, np.float32))[0][0] for _ in range(N)])

    def phi(z: float) -> float:
        return (1 + math.erf(z / math.sqrt(2))) / 2

    for seen, share in (
        (scans == 0, phi(-1)),
        (scans == np.float32(2.5 * sigma), 1 - phi(1.5)),
        (scans < r, 0.5),
        ((scans > r + sigma / 2) & (scans < r + sigma), phi(1) - phi(0.5)),
    ):
        assert abs(seen.mean() - share) < Z * math.sqrt(share * (1 - share) / N)


def test_unclipped_scans_are_exact_ranges_plus_normal_noise_of_each_beam():
    env = wide(noise=STILL, lidar={"beams": 2, "sigma": 100.0, "max_range": 60_000.0})
    env.reset(seed=4)
    scans = np.array([env.step(np.zeros(2, np.float32))[0] for _ in range(N)], dtype=float)
    # ±45° from the middle of a 40,000 px square: its corners, √2 · 20,000 px away. float32 keeps
    # such ranges to 2e-3 px, its angles to 1e-7 rad: nothing against the 0.7 px error of a mean.
    errors = scans - math.sqrt(2) * 20_000
    for beam in errors.T:
        check_moments(beam, 100.0)
    assert abs(np.corrcoef(*errors.T)[0, 1]) < Z / math.sqrt(N - 1)


def test_the_start_is_drawn_around_its_pose():
    env = calm(start={"sd_position": 3.0, "sd_heading": 0.2})
    starts = np.array([env.reset()[1]["truth"] for _ in range(2000)]) - (175, 50, 0)
    # 42 px to the walls are 14 standard deviations: no draw is refused
    for errors, sd in zip(starts.T, (3.0, 3.0, 0.2), strict=True):
        check_moments(errors, sd)


def test_a_start_that_would_touch_a_wall_is_drawn_again():
    env = calm(start={"pose": (20, 20, 0.0), "sd_position": 10.0})
    starts = np.array([env.reset()[1]["truth"] for _ in range(500)])
    # Without redrawing, Φ(-1.2) = 11.5 % of each of x and y would lie below the radius.
    assert starts[:, :2].min() > 8.0
    # They come up to the wall: 2.3 % of each lie between 8 and 9, and 0.977^1000 < 1e-10.
    assert starts[:, :2].min() < 9.0
