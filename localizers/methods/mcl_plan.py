"""p(x_t | a_{1:t}, o_{1:t}, π_{0:t}, m): map-based MCL, each plan shown an observation of x_t.

Ours. Authors do not plan through walls, so a plan is evidence of where its author believes the
robot to be: p(π_t | x_t, m) ∝ exp(-β C), where C planned steps collide without noise. Nothing is
queued after the present. A plan is only as good as its author's knowledge: one made from the
filter's own estimate merely confirms it, and a stale one misleads.
"""

from dataclasses import replace

from deqmcl_gym.validation import InputError, one_of
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.plan_evidence import (
    DoubtedPlans,
    Known,
    Lookahead,
    PlanEvidence,
    nothing_known,
    steps_known,
)
from localizers.methods.deq_mcl import mcl_map_smoother
from localizers.methods.family import FOR_THE_LOST, Shared, method
from localizers.models.prior import even_poses
from localizers.models.robot import RobotModel

_ANYWHERE = 512  # poses that represent free space

CHARGES: dict[str, Known] = {"always": nothing_known, "new": steps_known}


@method(*mcl_map_smoother.takes, *FOR_THE_LOST)
def mcl_plan(
    robot: RobotModel,
    shared: Shared,
    *,
    keep: float = 0.8,
    charge: str = "always",
    validity: float | None = None,
) -> ParticleFilter:
    """Return map-based MCL that uses the first ``lag`` = L steps of every plan as evidence.

    Args:
        robot, shared: see ``Shared``.
        keep: κ, the least share of the effective sample size that a plan leaves; 0 is exact.
        charge: "always", or "new": each planned step once, when it comes into view.
        validity: probability per step that plans become, or cease to be, about this robot; it
            replaces ``keep``, which must then be 0. None: plans always are.

    Raises:
        InputError: ``validity`` is given together with ``keep`` > 0 or ``charge`` = "new".
    """
    sensor = shared.sensor(robot)
    known = CHARGES[one_of("charge", charge, CHARGES)]
    evidence: Lookahead = PlanEvidence(sensor=sensor, steps=shared.lag, keep=keep, known=known)
    if validity is not None:
        if keep != 0 or charge != "always":
            raise InputError(
                f"validity is {validity!r}, keep {keep:g} and charge {charge!r}, but a plan of "
                "doubtful validity is neither tempered nor charged in part: give keep = 0 and "
                "charge = 'always', or leave validity out."
            )
        anywhere = even_poses(robot.floor_plan, _ANYWHERE)
        evidence = DoubtedPlans(
            sensor=sensor, anywhere=anywhere, switching=validity, steps=shared.lag
        )
    return replace(mcl_map_smoother.build(robot, shared), lookahead=evidence)
