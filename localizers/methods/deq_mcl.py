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
- ``deq-mcl-rejuvenated``: the same Q(t), with the queued future renewed at every step. The
  published filter draws x_t L steps before it becomes the present and resamples it L times in
  between, without fresh noise. Here a resample-move step (Gilks & Berzuini 2001) proposes a fresh
  future for every particle and accepts it by its feasibility. The target stays the same.
"""

from collections.abc import Callable
from dataclasses import replace

from deqmcl_gym.validation import integer, one_of
from localizers.inference.beam_filters import beam_filter
from localizers.inference.futures import Move, RenewedFuture, Sometimes, WhenResampled
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
        tempering=shared.tempering,
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
        robot, shared: see ``Shared``.
        pilots: M, rollouts per particle when the executed action or the plan differs from the
            actions that the queue was drawn with.
    """
    base = mcl_map_smoother.build(robot, shared)
    return replace(base, future=shared.lag, pilots=integer("pilots", pilots, low=1))


MOVES: dict[str, Callable[[Move], Move]] = {
    "always": lambda move: move,
    "resampled": WhenResampled,
    "third": lambda move: Sometimes(move, 1 / 3),
}


@method(*deq_mcl.takes)
def deq_mcl_rejuvenated(
    robot: RobotModel, shared: Shared, *, pilots: int = 16, moves: str = "always"
) -> ParticleFilter:
    """Return DEQ-MCL with a renewed future.

    Args:
        robot, shared, pilots: as for ``deq_mcl``.
        moves: "always"; "third", at each step with probability 1/3; or "resampled", only at the
            steps that resample (meant for ``ess_threshold`` = 0.5). The first two are exactly
            invariant, the last one in the limit of many particles.
    """
    when = MOVES[one_of("moves", moves, MOVES)]
    base = deq_mcl.build(robot, shared, pilots=pilots)
    return replace(base, move=when(RenewedFuture(base.rollout)))
