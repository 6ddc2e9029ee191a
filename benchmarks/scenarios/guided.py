"""Where localization is needed: dead reckoning loses the robot."""

from benchmarks.setup.priors import Gaussian
from benchmarks.setup.scenario import Scenario
from localizers import CensoredGaussianUniform, OdometryMotion

SCENARIO = Scenario(
    words="large motion noise, and a driver who sees the true pose; the filters know the noise",
    env={"preset": "guided"},
    motion=OdometryMotion(drive=0.2, turn=0.2, drift=0.02),
    # the world's but for the uniform share of the beams
    scan=CensoredGaussianUniform(sigma=100.0),
    prior=Gaussian(sd_position=5.0, sd_heading=0.05),
)
