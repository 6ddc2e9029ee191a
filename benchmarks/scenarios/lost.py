"""Somewhere in an office building, with a dispatcher's route ahead."""

import math

from benchmarks.setup.priors import Uniform
from benchmarks.setup.scenario import Scenario
from benchmarks.setup.thresholds import Thresholds
from localizers import CensoredGaussianUniform, OdometryMotion

SCENARIO = Scenario(
    words="16 beams in an office building; a dispatcher's route, and no idea of the start",
    env={
        "preset": "paper",
        "floor_plan": {"office": {"wings": 2, "corridors": 2}},
        "lidar": {"beams": 16, "field_of_view": 2 * math.pi, "max_range": 12.0, "sigma": 0.5},
        "robot": {"radius": 0.25},
        "noise": {"drive": 0.1, "turn": 0.1, "drift": 0.1},  # per m
        "lap": {"step": 0.2},
        "route": {"min_length": 20.0, "max_length": 60.0},
        "driver": {},
    },
    motion=OdometryMotion(drive=0.1, turn=0.1, drift=0.1),
    # the world's but for the uniform share of the beams
    scan=CensoredGaussianUniform(sigma=0.5),
    prior=Uniform(),
    thresholds=Thresholds(far=1.0, lost=1.0),
    buildings=20,
)
