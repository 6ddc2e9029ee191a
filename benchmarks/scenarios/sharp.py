"""A sensor that says much."""

from benchmarks.setup.scenario import Scenario
from localizers import CensoredGaussianUniform, OdometryMotion

SCENARIO = Scenario(
    words="nine sharp beams; the filters assume five times the motion noise (drift: twenty times)",
    env={"preset": "sharp"},
    motion=OdometryMotion(drive=0.1, turn=0.1, drift=0.01),
    # the world's but for the uniform share of the beams
    scan=CensoredGaussianUniform(sigma=5.0),
)
