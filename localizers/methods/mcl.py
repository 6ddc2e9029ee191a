"""p(x_t | a_{1:t}, o_{1:t}, m): Monte-Carlo localization, knowing neither the plan nor walls.

Dellaert et al. 1999; Thrun et al. 2005, table 8.2. The map serves the sensor model only.
"""

from localizers.api import RobotModel
from localizers.inference.particle_localizer import ParticleLocalizer


def mcl(
    robot: RobotModel,
    *,
    particles: int = 1000,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return MCL.

    Args:
        robot: what the localizer is made for.
        particles: N.
        resampler: "systematic", "stratified" or "multinomial".
        ess_threshold: resample only when the effective sample size is below this share of N;
            None resamples at every step, as the paper does.
    """
    return ParticleLocalizer.plain(
        robot, particles=particles, resampler=resampler, ess_threshold=ess_threshold
    )
