"""Methods that take the plan as evidence of the present; no state waits in a queue to become it.

- ``mcl-plan``: p(x_t | a_{1:t}, o_{1:t}, π_{0:t}, m), map-based MCL, each plan shown an observation
  of x_t. Ours. Authors do not plan through walls, so a plan is evidence of where its author
  believes the robot to be: p(π_t | x_t, m) ∝ exp(-β C), where C planned steps collide without
  noise. A plan is only as good as its author's knowledge: one made from the filter's own estimate
  merely confirms it, and a stale one misleads.
- ``deq-mcl-fresh``: DEQ-MCL whose future is drawn anew from the present after each scan. Its
  target is the paper's Q(t): p(x_t) ∝ α_t(x_t) h_t(x_t), α_t of the scans and steps so far and
  h_t(x) = E[Π g of the next L planned steps | x_t = x], from roll-outs (pilots: Lin, Chen & Liu
  2013). With ``evidence`` = "plan" the plan is the observation that ``mcl-plan`` makes of it
  instead, and the future is p(x_{t+1:t+L} | x_t, plan, m), which changes no weight.
"""

from dataclasses import replace

from deqmcl_gym.validation import InputError, integer, one_of
from localizers.inference.hedge import Hedge, predictive
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.plan_evidence import Foresight, PlanEvidence
from localizers.methods.deq_mcl import mcl_map_smoother
from localizers.methods.family import FOR_THE_LOST, Shared, method
from localizers.models.robot import RobotModel


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
        keep: κ, the least share of the effective sample size that a plan leaves; 0 is exact.
        charge: "always", or "new": each planned step once, when it comes into view.
    """
    new_only = one_of("charge", charge, ("always", "new")) == "new"
    sensor = shared.sensor(robot)
    evidence = PlanEvidence(sensor=sensor, steps=shared.lag, keep=keep, new_only=new_only)
    return replace(mcl_map_smoother.build(robot, shared), lookahead=evidence)


@method(*mcl_plan.takes)
def deq_mcl_fresh(
    robot: RobotModel,
    shared: Shared,
    *,
    evidence: str = "future",
    pilots: int = 8,
    keep: float | None = None,
    charge: str | None = None,
) -> ParticleFilter:
    """Return DEQ-MCL whose future is drawn anew from the present after each scan.

    Args:
        evidence: what judges the present beside scan and map: "future", how feasible the drawn
            futures are, the paper's target; "plan", the plan as ``mcl_plan`` reads it.
        pilots: M, roll-outs of each particle, of which one is kept.
        keep, charge: of "plan" alone, see ``mcl_plan``; None: 0.8 and "new".

    Raises:
        InputError: ``keep`` or ``charge`` with "future".
    """
    integer("pilots", pilots, low=1)
    if one_of("evidence", evidence, ("future", "plan")) == "plan":
        keep, charge = 0.8 if keep is None else keep, "new" if charge is None else charge
        base = mcl_plan.build(robot, shared, keep=keep, charge=charge)
    else:
        for name, given in {"keep": keep, "charge": charge}.items():
            if given is not None:
                raise InputError(
                    f"{name} is {given!r}, but it is used only with evidence = 'plan': give that, "
                    f"or leave {name} out."
                )
        base = mcl_map_smoother.build(robot, shared)
    ahead = Foresight(
        rollout=base.rollout,
        steps=shared.lag,
        copies=pilots,
        weighs=evidence == "future",
        evidence=base.lookahead,
    )
    return replace(base, lookahead=ahead)


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
        shared: see ``Shared``; ``start_draws`` is for the half that is shown plans.
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
        advised=predictive(shown),
        protected=predictive(mcl_map_smoother.build(robot, protected)),
        switching=switching,
        trust=trust,
        mutual=mutual,
        own_plans=own_plans,
    )
