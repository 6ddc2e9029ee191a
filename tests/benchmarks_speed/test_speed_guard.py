"""A guard against slow code: ratios within one process, never a time. Far below what we aim at."""

import pytest

from benchmarks.studies.speed.command import FIGURES
from benchmarks.studies.speed.figure import Effort, is_time, measured

BOUNDS = {
    "rays_vs_numpy": 3.0,
    "rays_vs_pymunk": 200.0,
    "step1k_vs_numpy": 1.5,
    "deq_vs_map_step": 2.0,
    "deq_lag80_vs_lag10": 1.6,
}


@pytest.mark.slow
@pytest.mark.parametrize("figure", [f for f in FIGURES if f.name in BOUNDS], ids=lambda f: f.name)
def test_we_do_not_fall_far_behind(figure):
    ratio = measured(figure, Effort(repeats=9, seconds=0.05)).ratio
    bound = BOUNDS[figure.name]
    assert ratio < bound if is_time(figure.unit) else ratio > bound
