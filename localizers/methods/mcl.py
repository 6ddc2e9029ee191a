"""p(x_t | a_{1:t}, o_{1:t}, m): Monte-Carlo localization, without the plan and without collisions.

Dellaert et al. 1999; Thrun et al. 2005, table 8.2. The map serves the sensor model only.
"""

from localizers.api import RobotModel
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.trust import Trust
from localizers.methods.family import Shared, method
from localizers.models.scan import LidarScan


@method("particles", "resampler", "ess_threshold")
def mcl(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL, of which all other members of the family are variations."""
    scan = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
    return ParticleFilter(
        motion=robot.motion,
        scan=scan,
        resampling=shared.resampling,
        particles=shared.particles,
        trust=Trust.of(scan, robot.floor_plan),
    )
