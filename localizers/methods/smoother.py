"""p(x_{t-L:t} | a_{1:t}, o_{1:t}, m): MCL with fixed-lag smoothing.

Kitagawa 1996: the past states of each particle are resampled together with its present, so the
observations up to t weight x_{t-L}. At x_t it is MCL, number for number.
"""

from dataclasses import replace

from localizers.api import RobotModel
from localizers.inference.particle_filter import ParticleFilter
from localizers.methods.family import Shared, method
from localizers.methods.map_motion import mcl_map
from localizers.methods.mcl import mcl


@method(*mcl.takes, "lag")
def mcl_smoother(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL with a fixed-lag smoother of ``lag`` = L steps."""
    return replace(mcl.build(robot, shared), past=shared.lag)


@method(*mcl.takes, "beta", "lag")
def mcl_map_smoother(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return map-based MCL with a smoother: DEQ-MCL without its future, the ablation."""
    return replace(mcl_map.build(robot, shared), past=shared.lag)
