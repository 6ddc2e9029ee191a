"""The methods of the paper, from MCL to DEQ-MCL; each differs from the one before in few parts.

- ``mcl``: p(x_t | a_{1:t}, o_{1:t}, m), without the plan and without collisions. Dellaert et al.
  1999; Thrun et al. 2005, table 8.2. The map serves the sensor model only.
- ``mcl-smoother``: p(x_{t-L:t} | a_{1:t}, o_{1:t}, m), fixed-lag smoothing. Kitagawa 1996: the past
  states of each particle are resampled together with its present, so the observations up to t
  weight x_{t-L}. At x_t it is MCL, number for number.
- ``mcl-map``: p(x_t | a_{1:t}, o_{1:t}, every step so far feasible, m). The paper's eq. (1),
  p(x_t | x_{t-1}, a_t, m) ≈ p(x_t | x_{t-1}, a_t) p(x_t | m); Thrun et al. 2005, section 5.5; Oh et
  al. 2004.
- ``deq-mcl``: Q(t) = p(x_{t-L:t+L} | a_{1:t}, â_{t+1:T}, o_{1:t}, m). Taniguchi, Fukawa & Yamakawa
  2024, eqs. (2)-(3): a queue of past, present and future states; the planned future is drawn ahead,
  charged for collisions, and resampled together with the present.
  x_t is drawn L steps before its scan arrives: with a sharp sensor few of those draws survive it
  (docs/queue.md). ``deq-mcl-fresh``, in ``plan_aware``, mends that.
"""

from dataclasses import replace

from deqmcl_gym.validation import integer
from localizers.inference.beam_filters import beam_filter
from localizers.inference.loss_detector import LossDetector
from localizers.inference.particle_filter import ParticleFilter
from localizers.methods.family import FOR_THE_LOST, ON_THE_MAP, Shared, method
from localizers.models.robot import RobotModel


@method("particles", "resampler", "ess_threshold", "beam_filter")
def mcl(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL, of which all other members of the family are variations."""
    scan = robot.scan_model()
    return ParticleFilter(
        motion=robot.motion,
        scan=scan,
        resampling=shared.resampling,
        particles=shared.particles,
        beams=beam_filter(shared.beam_filter, robot),
        detector=LossDetector.of(scan, robot.floor_plan),
    )


@method(*mcl.takes, "beta", *ON_THE_MAP, *FOR_THE_LOST)
def mcl_map(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL whose steps are charged exp(-``beta``) if they collide.

    With an ``inflation_radius`` or a ``cost_map`` they are also charged for where they end. It
    reads plans only to choose poses, with ``start_draws`` of 2 or more.
    """
    return replace(
        mcl.build(robot, shared),
        feasibility=shared.feasibility(robot),
        start=shared.start(robot),
        keep=shared.scan_keep,
        injection=shared.injection(robot),
    )


@method(*mcl.takes, "lag")
def mcl_smoother(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return MCL with a fixed-lag smoother of ``lag`` = L steps."""
    return replace(mcl.build(robot, shared), past=shared.lag)


@method(*mcl.takes, "beta", *ON_THE_MAP, "lag")
def mcl_map_smoother(robot: RobotModel, shared: Shared) -> ParticleFilter:
    """Return map-based MCL with a smoother: DEQ-MCL without its future, the ablation."""
    return replace(mcl_map.build(robot, shared), past=shared.lag)


@method(*mcl_map_smoother.takes)
def deq_mcl(robot: RobotModel, shared: Shared, *, pilots: int = 16) -> ParticleFilter:
    """Return DEQ-MCL with a queue of ``lag`` = L steps to either side.

    Args:
        pilots: M, rollouts per particle when the executed action or the plan differs from the
            actions that the queue was drawn with.
    """
    base = mcl_map_smoother.build(robot, shared)
    return replace(base, future=shared.lag, pilots=integer("pilots", pilots, low=1))
