"""Methods that take the plan as evidence of the present; nothing is queued, so nothing degenerates.

- ``mcl-pilots``: p(x_t) ∝ α_t(x_t) h_t(x_t), map-based MCL, weighted by how feasible the plan is
  from x_t. α_t covers the scans and steps so far, h_t(x) = E[Π g of the next L planned steps |
  x_t = x], from rollouts (lookahead, pilots: Lin, Chen & Liu 2013). The target is DEQ-MCL's.
- ``mcl-plan``: p(x_t | a_{1:t}, o_{1:t}, π_{0:t}, m), map-based MCL, each plan shown an observation
  of x_t. Ours. Authors do not plan through walls, so a plan is evidence of where its author
  believes the robot to be: p(π_t | x_t, m) ∝ exp(-β C), where C planned steps collide without
  noise. A plan is only as good as its author's knowledge: one made from the filter's own estimate
  merely confirms it, and a stale one misleads.
"""

from dataclasses import replace

from deqmcl_gym.validation import InputError, integer, one_of
from localizers.inference.hedge import Hedge, judging
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.plan_evidence import (
    Known,
    Pilots,
    PlanEvidence,
    nothing_known,
    steps_known,
)
from localizers.methods.deq_mcl import mcl_map_smoother
from localizers.methods.family import FOR_THE_LOST, Shared, method
from localizers.models.robot import RobotModel


@method(*mcl_map_smoother.takes)
def mcl_pilots(robot: RobotModel, shared: Shared, *, pilots: int = 8) -> ParticleFilter:
    """Return map-based MCL with h_t from rollouts over ``lag`` = L planned steps.

    Args:
        robot, shared: see ``Shared``.
        pilots: K, fresh rollouts per particle and step.
    """
    base = mcl_map_smoother.build(robot, shared)
    pilots = integer("pilots", pilots, low=1)
    return replace(base, lookahead=Pilots(rollout=base.rollout, steps=shared.lag, pilots=pilots))


CHARGES: dict[str, Known] = {"always": nothing_known, "new": steps_known}


@method(*mcl_map_smoother.takes, *FOR_THE_LOST)
def mcl_plan(
    robot: RobotModel,
    shared: Shared,
    *,
    keep: float = 0.8,
    charge: str = "always",
) -> ParticleFilter:
    """Return map-based MCL that uses the first ``lag`` = L steps of every plan as evidence.

    Args:
        robot, shared: see ``Shared``.
        keep: κ, the least share of the effective sample size that a plan leaves; 0 is exact.
        charge: "always", or "new": each planned step once, when it comes into view.
    """
    sensor = shared.sensor(robot)
    known = CHARGES[one_of("charge", charge, CHARGES)]
    evidence = PlanEvidence(sensor=sensor, steps=shared.lag, keep=keep, known=known)
    return replace(mcl_map_smoother.build(robot, shared), lookahead=evidence)


# without beam_filter: the two would be judged by different beams
@method(*(name for name in mcl_plan.takes if name != "beam_filter"))
def mcl_plan_hedged(
    robot: RobotModel,
    shared: Shared,
    *,
    switching: float = 0.001,
    trust: float = 0.5,
    mutual: bool = False,
    plans: str = "all",
    own_plans: bool = True,
) -> Hedge:
    """Return a hedge of ``mcl_plan``, exact, and ``mcl_map``, each with half of the particles.

    Args:
        robot, shared: see ``Shared``; ``start_draws`` is for the half that is shown plans.
        switching, trust, mutual, own_plans: see ``Hedge``.
        plans: "all": each is evidence; "first": they only choose poses, by ``start_draws``.

    Raises:
        InputError: fewer than two particles; or ``plans`` = "first" with ``start_draws`` = 1.
    """
    integer("particles", shared.particles, low=2)
    advised = replace(shared, particles=shared.particles // 2)
    protected = replace(
        shared, particles=shared.particles - advised.particles, start_draws=1, start_jitter=0.0
    )
    if one_of("plans", plans, ("all", "first")) == "all":
        shown = mcl_plan.build(robot, advised, keep=0.0)
    elif shared.start_draws > 1:
        shown = mcl_map_smoother.build(robot, advised)
    else:
        raise InputError(
            "plans is 'first' and start_draws 1, but so no plan is used: give start_draws of 2 or "
            "more, or plans = 'all'."
        )
    return Hedge(
        advised=judging(shown),
        protected=judging(mcl_map_smoother.build(robot, protected)),
        switching=switching,
        trust=trust,
        mutual=mutual,
        own_plans=own_plans,
    )
