"""p(x_t) ∝ α_t(x_t) h_t(x_t): map-based MCL, weighted by how feasible the plan is from x_t.

α_t covers the scans and steps so far, h_t(x) = E[Π g of the next L planned steps |
x_t = x]. The target is DEQ-MCL's, but the future is not queued, so nothing degenerates
while it waits. h_t comes from a table or from rollouts: Lin, Chen & Liu 2013 (lookahead, pilots);
as a twist of the filter: Whiteley & Lee 2014; Guarniero, Johansen & Lee 2017.
"""

from dataclasses import replace

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.validation import integer, one_of
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.plan_evidence import Pilots, Tabulated
from localizers.inference.resampling import Selection, by_own_weight, by_reported_weight
from localizers.methods.deq_mcl import mcl_map_smoother
from localizers.methods.family import Shared, method
from localizers.models.lookahead_grid import LookaheadGrid
from localizers.models.motion import odometry
from localizers.models.robot import RobotModel

FORMS: dict[str, Selection] = {"estimate": by_own_weight, "twisted": by_reported_weight}


@method(*mcl_map_smoother.takes)
def mcl_h(
    robot: RobotModel,
    shared: Shared,
    *,
    form: str = "estimate",
    cell: float | None = None,
    headings: int = 72,
) -> ParticleFilter:
    """Return map-based MCL with a table of h_t over ``lag`` = L planned steps.

    Args:
        robot, shared: see ``Shared``.
        form: "estimate": h weights the report only, the cloud is that of ``mcl_map``;
            "twisted": h also enters resampling.
        cell: distance between nodes of the table, in the map's unit; None is 5 px, or 0.1 m.
        headings: how many the table has, evenly spaced.

    Raises:
        InputError: the robot's motion is neither an ``OdometryMotion`` nor a
            ``DifferentialMotion``.
    """
    grid = LookaheadGrid(
        floor_plan=robot.floor_plan,
        radius=robot.radius,
        beta=shared.beta,
        motion=odometry(robot.motion, "mcl-h"),
        cell=5 * pixel(robot.floor_plan.unit) if cell is None else cell,
        headings=headings,
    )
    return replace(
        mcl_map_smoother.build(robot, shared),
        lookahead=Tabulated(table=grid, steps=shared.lag),
        selection=FORMS[one_of("form", form, FORMS)],
    )


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
