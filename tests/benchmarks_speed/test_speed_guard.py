"""A guard against slow code: ratios within one process, never a time. Far below what we aim at."""

import pytest

from benchmarks.speed import rays, steps
from benchmarks.speed.figure import measured
from benchmarks.speed.timing import Effort

LEAST = {"rays_vs_numpy": 3.0, "rays_vs_pymunk": 200.0, "step1k_vs_numpy": 1.5}
MOST = {"deq_vs_map_step": 2.0, "deq_lag80_vs_lag10": 1.6}
FIGURES = {figure.name: figure for figure in (*rays.FIGURES, *steps.FIGURES)}


def ratio(name):
    return measured(FIGURES[name], Effort(repeats=9, seconds=0.05)).ratio


@pytest.mark.slow
@pytest.mark.parametrize("name", LEAST)
def test_rates_stay_ahead_of_the_plain_form(name):
    assert ratio(name) > LEAST[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", MOST)
def test_the_queue_costs_little(name):
    assert ratio(name) < MOST[name]
