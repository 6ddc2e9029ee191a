"""p(x_t | a_{1:t}, o_{1:t}, every step so far feasible, m): MCL with a map-based motion model.

The paper's eq. (1), p(x_t | x_{t-1}, a_t, m) ≈ p(x_t | x_{t-1}, a_t) p(x_t | m); Thrun et al. 2005,
section 5.5; Oh et al. 2004.
"""

from dataclasses import replace

from localizers.api import RobotModel
from localizers.inference.particle_filter import ParticleFilter
from localizers.methods.family import FOR_THE_LOST, Shared, method
from localizers.methods.mcl import mcl
from localizers.models.feasibility import FreeSpace


@method(*mcl.takes, "beta", *FOR_THE_LOST)
def mcl_map(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL whose steps are charged exp(-``beta``) if they collide.

    It reads plans only to choose poses, with ``start_draws`` of 2 or more.
    """
    return replace(
        mcl.build(robot, shared),
        feasibility=FreeSpace(floor_plan=robot.floor_plan, radius=robot.radius, beta=shared.beta),
        start=shared.start(robot),
        tempering=shared.tempering,
        injection=shared.injection(robot),
    )
