"""To a goal in an office building, planned and driven on the localizer's estimate."""

from dataclasses import replace

from benchmarks.scenarios import lost
from benchmarks.setup.priors import Gaussian

SCENARIO = replace(
    lost.SCENARIO,
    words="16 beams in an office building; planned and driven to a goal on the estimate",
    env={**lost.SCENARIO.env, "start": {"sd_position": 0.1, "sd_heading": 0.1}},
    prior=Gaussian(sd_position=0.1, sd_heading=0.1),
    agent="to-goal",
)
