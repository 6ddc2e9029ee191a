"""As ``lost``, with a sensor that says little."""

from dataclasses import replace

from benchmarks.scenarios import lost
from localizers import CensoredGaussianUniform

SCENARIO = replace(
    lost.SCENARIO,
    words="as lost, with one weak beam ahead",
    env={**lost.SCENARIO.env, "lidar": {"beams": 1, "max_range": 12.0, "sigma": 1.0}},
    scan=CensoredGaussianUniform(sigma=1.0),
)
