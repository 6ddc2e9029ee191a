"""Q(t) of DEQ-MCL, with the queued future renewed at every step.

The published filter draws x_t L steps before it becomes the present and resamples it L times in
between, without fresh noise. Here a resample-move step (Gilks & Berzuini 2001) proposes a
fresh future for every particle and accepts it by its feasibility. The target stays the same.
"""

from collections.abc import Callable
from dataclasses import replace

from deqmcl_gym.validation import one_of
from localizers.api import RobotModel
from localizers.inference.moves import Move, RenewedFuture, Sometimes, WhenResampled
from localizers.inference.particle_filter import ParticleFilter
from localizers.methods.deq_mcl import deq_mcl
from localizers.methods.family import Shared, method

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
