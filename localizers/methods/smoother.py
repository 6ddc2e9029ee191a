"""p(x_{t-L:t} | a_{1:t}, o_{1:t}, m): MCL with fixed-lag smoothing.

Kitagawa 1996: the past states of each particle are resampled together with its present, so the
observations up to t weight x_{t-L}. At x_t it is MCL, number for number.
"""

from deqmcl_gym.validation import integer
from localizers.api import RobotModel
from localizers.inference.particle_localizer import ParticleLocalizer
from localizers.methods.map_motion import mcl_map
from localizers.methods.mcl import mcl


def mcl_smoother(
    robot: RobotModel,
    *,
    particles: int = 1000,
    lag: int = 20,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return MCL with a fixed-lag smoother of ``lag`` = L steps; else as ``mcl``."""
    base = mcl(robot, particles=particles, resampler=resampler, ess_threshold=ess_threshold)
    return base.varied(past=integer("lag", lag))


def mcl_map_smoother(
    robot: RobotModel,
    *,
    particles: int = 1000,
    lag: int = 20,
    beta: float = 10.0,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return map-based MCL with a smoother: DEQ-MCL without its future, the ablation."""
    base = mcl_map(
        robot, particles=particles, beta=beta, resampler=resampler, ess_threshold=ess_threshold
    )
    return base.varied(past=integer("lag", lag))
