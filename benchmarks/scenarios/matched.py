"""All that the filters assume is right: where calibration is judged."""

from benchmarks.setup.scenario import Scenario
from localizers import CensoredGaussianUniform, OdometryMotion

SCENARIO = Scenario(
    words="one weak beam; the filters know the true noise, sensor and start",
    env={"preset": "matched"},
    motion=OdometryMotion(drive=0.02, turn=0.02, drift=0.0005),
    # the world's but for the uniform share of the beams
    scan=CensoredGaussianUniform(sigma=100.0),
)
