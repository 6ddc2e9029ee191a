"""A recorded log of a real robot: each world is a segment of it."""

from benchmarks.setup.logs import LogScenario
from benchmarks.setup.priors import Gaussian
from benchmarks.setup.thresholds import Thresholds
from localizers import GaussianUniform
from localizers.models.nav2_motion import unknown_motion

SCENARIO = LogScenario(
    words="segments of a recorded log, named by log, map and reference in a file of your own",
    env={"segment": 50.0, "every": "0.2m,5deg", "max_beams": 60},
    motion=unknown_motion("differential", "m"),  # what is not given if some of it is
    scan=GaussianUniform(sigma=0.2),  # Nav2's sigma_hit
    prior=Gaussian(sd_position=0.2, sd_heading=0.1),
    thresholds=Thresholds(far=1.0, lost=1.0),
)
