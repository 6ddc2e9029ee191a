"""p(x_t | a_{1:t}, o_{1:t}, every step so far feasible, m): MCL with a map-based motion model.

The paper's eq. (1), p(x_t | x_{t-1}, a_t, m) ≈ p(x_t | x_{t-1}, a_t) p(x_t | m); Thrun et al. 2005,
section 5.5; Oh et al. 2004.
"""

from dataclasses import replace

from localizers.api import RobotModel
from localizers.inference.particle_filter import ParticleFilter
from localizers.methods.family import Shared, method
from localizers.methods.mcl import mcl
from localizers.models.feasibility import FreeSpace


@method(*mcl.takes, "beta")
def mcl_map(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL whose steps are charged exp(-``beta``) if they collide."""
    free_space = FreeSpace(floor_plan=robot.floor_plan, radius=robot.radius, beta=shared.beta)
    return replace(mcl.build(robot, shared), feasibility=free_space)
