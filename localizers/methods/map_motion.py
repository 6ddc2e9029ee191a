"""p(x_t | a_{1:t}, o_{1:t}, every step so far feasible, m): MCL with a map-based motion model.

The paper's eq. (1), p(x_t | x_{t-1}, a_t, m) ≈ p(x_t | x_{t-1}, a_t) p(x_t | m); Thrun et al. 2005,
section 5.5; Oh et al. 2004.
"""

from localizers.api import RobotModel
from localizers.inference.particle_localizer import ParticleLocalizer
from localizers.methods.mcl import mcl
from localizers.models.feasibility import FreeSpace


def mcl_map(
    robot: RobotModel,
    *,
    particles: int = 1000,
    beta: float = 10.0,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return MCL whose steps are charged exp(-``beta``) if they collide; else as ``mcl``."""
    base = mcl(robot, particles=particles, resampler=resampler, ess_threshold=ess_threshold)
    return base.varied(
        feasibility=FreeSpace(floor_plan=robot.floor_plan, radius=robot.radius, beta=beta)
    )
