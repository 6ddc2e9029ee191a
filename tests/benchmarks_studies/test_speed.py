"""Speed: rates by turns, sides that do the same, and bounds on ratios within one process."""

import csv
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import reference

from benchmarks.studies import speed
from benchmarks.studies.speed import RATIOS, Effort, Job, beside
from deqmcl_gym.world import PAPER_ROOM

DOCS = Path(__file__).parents[2] / "docs" / "speed.md"
BOUNDS = {  # of ratios within one process, never a time; far from what we aim at
    "rays_vs_numpy": (3.0, math.inf),
    "deq_vs_map_step": (0.0, 2.0),
    "deq_lag80_vs_lag10": (0.0, 1.6),
}


def lasting(seconds):
    """A job on a clock that passes only as it says."""
    clock = itertools.count(step=seconds)
    return lambda: Job(lambda: None, clock=lambda: next(clock))


def test_the_command_writes_ours_over_the_others(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(speed, "RATIOS", [beside("a", "steps/s", lasting(0.5), lasting(0.25))])
    speed.measure(["--quick", "--out", str(tmp_path / "new")])
    rows = list(csv.reader((tmp_path / "new" / "speed.csv").open()))
    assert rows == [["figure", "ours", "other", "ratio"], ["a", "2", "4", "0.5"]]
    assert "steps/s" in capsys.readouterr().out


def test_docs_explain_every_figure():
    words = DOCS.read_text()
    assert [one.name for one in RATIOS if f"`{one.name}`" not in words] == []


def test_ranges_in_numpy_are_exact_within_a_turn_that_float32_cannot_resolve():
    poses = speed.free_poses(PAPER_ROOM, 3_000)  # several blocks
    turned = (speed.BEARINGS + turn for turn in (-2e-6, 0, 2e-6))
    around = [reference.ranges(PAPER_ROOM.walls, poses, bearings) for bearings in turned]
    seen = speed.numpy_ranges(PAPER_ROOM, poses)
    slack = 5e-4  # px: a product, a quotient and differences of coordinates to 350
    assert (seen >= np.min(around, axis=0) - slack).all()
    assert (seen <= np.max(around, axis=0) + slack).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", BOUNDS)
def test_we_do_not_fall_far_behind(name):
    (ratio,) = (one for one in RATIOS if one.name == name)
    low, high = BOUNDS[name]
    assert low < np.divide(*ratio.sides(Effort(9, seconds=0.05))) < high
