"""Speed: rates by turns, sides that do the same, and bounds on ratios within one process."""

import csv
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import reference

from benchmarks.studies import speed
from benchmarks.studies.speed import RATIOS, Effort, Job, Ratio
from deqmcl_gym.world.presets import PAPER_ROOM
from localizers import make

DOCS = Path(__file__).parents[2] / "docs" / "speed.md"


def lasting(seconds):
    """A job on a clock that passes only as it says."""
    clock = itertools.count(step=seconds)
    return lambda: Job(lambda: None, clock=lambda: next(clock))


def test_the_command_writes_ours_over_the_others_and_no_ratio_beside_another_machine(
    monkeypatch, tmp_path, capsys
):
    ratios = [Ratio(n, "steps/s", lasting(0.5), o) for n, o in (("a", lasting(0.25)), ("b", 9.0))]
    monkeypatch.setattr(speed, "RATIOS", ratios)
    speed.measure(["--quick", "--out", str(tmp_path / "new")])
    rows = list(csv.reader((tmp_path / "new" / "speed.csv").open()))
    assert rows == [
        ["figure", "ours", "other", "ratio"],
        ["a", "2", "4", "0.5"],
        ["b", "2", "9", ""],
    ]
    assert "steps/s" in capsys.readouterr().out


def test_docs_explain_every_figure():
    words = DOCS.read_text()
    assert [one.name for one in RATIOS if f"`{one.name}`" not in words] == []


def test_ranges_in_numpy_are_exact_within_a_turn_that_float32_cannot_resolve():
    poses = speed.free_poses(PAPER_ROOM, 3_000)  # several blocks
    around = [
        reference.ranges(PAPER_ROOM.walls, poses, speed.BEARINGS + turn)
        for turn in (-2e-6, 0, 2e-6)
    ]
    seen = speed.numpy_ranges(PAPER_ROOM, np.ascontiguousarray(poses.T)).T
    slack = 5e-4  # px: a product, a quotient and differences of coordinates to 350
    assert (seen >= np.min(around, axis=0) - slack).all()
    assert (seen <= np.max(around, axis=0) + slack).all()


def ends(mcl, runs=12, particles=500):
    """Mean (x, y, cos θ, sin θ) after 30 steps of each of some runs along the lap."""
    lap, found = speed.recorded_lap(), []
    for seed in range(runs):
        update = mcl(lap.robot, particles, lap.prior, np.random.default_rng(seed))
        for step in lap.steps[:30]:
            poses, weights = update(*step)
        x, y, heading = np.asarray(poses, dtype=float).T
        found.append(np.average([x, y, np.cos(heading), np.sin(heading)], axis=1, weights=weights))
    return np.mean(found, axis=0), np.var(found, axis=0, ddof=1) / runs


def our_mcl(robot, particles, prior, rng):
    localizer = make("mcl", robot, particles=particles)
    localizer.reset(prior, speed.recorded_lap().first, rng)
    return lambda *step: localizer.update(*step).points()


def test_estimates_in_numpy_are_ours_within_their_scatter():
    (ours, our_error), (theirs, their_error) = ends(our_mcl), ends(speed.numpy_mcl)
    error = np.sqrt(our_error + their_error)
    # Welch's t with some 15 to 22 degrees of freedom; |t| > 5 in 4 components: below 1 in 1,000
    assert (np.abs(ours - theirs) < 5 * error).all()
    assert error[:2].max() < 2.0  # px: agreement means something


BOUNDS = {  # of ratios within one process, never a time; far from what we aim at
    "rays_vs_numpy": (3.0, math.inf),
    "step10k_vs_numpy": (1.5, math.inf),
    "deq_vs_map_step": (0.0, 2.0),
    "deq_lag80_vs_lag10": (0.0, 1.6),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BOUNDS)
def test_we_do_not_fall_far_behind(name):
    (ratio,) = (one for one in RATIOS if one.name == name)
    low, high = BOUNDS[name]
    assert low < ratio.measured(Effort(9, seconds=0.05))[2] < high
