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
from localizers.models.plan_sensor import PlanSensor


@method(*mcl.takes, "beta", "start_draws", "start_jitter")
def mcl_map(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL whose steps are charged exp(-``beta``) if they collide.

    So are those of the plan shown at reset, if ``start_draws`` is more than 1.
    """
    free_space = FreeSpace(floor_plan=robot.floor_plan, radius=robot.radius, beta=shared.beta)
    sensor = PlanSensor(floor_plan=robot.floor_plan, radius=robot.radius, beta=shared.beta)
    base = mcl.build(robot, shared)
    return replace(base, feasibility=free_space, start=shared.start(sensor))
