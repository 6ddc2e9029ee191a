"""p(x_t) ∝ α_t(x_t) h_t(x_t): map-based MCL, weighted by how feasible the plan is from x_t.

α_t is what the filter knows of scans and steps so far, h_t(x) = E[Π g of the next L planned steps |
x_t = x]. The target is DEQ-MCL's, but the future is not queued, so nothing degenerates by waiting.
h_t from a table or from rollouts: Lin, Chen & Liu 2013 (lookahead, pilots); as a twist of the
filter: Whiteley & Lee 2014; Guarniero, Johansen & Lee 2017.
"""

from deqmcl_gym.validation import InputError, integer, one_of
from localizers.api import RobotModel
from localizers.inference.lookahead import Pilots, Tabulated
from localizers.inference.particle_localizer import ParticleLocalizer
from localizers.inference.resampling import Selection, by_own_weight, by_reported_weight
from localizers.methods.smoother import mcl_map_smoother
from localizers.models.lookahead_grid import LookaheadGrid
from localizers.models.motion import OdometryMotion

FORMS: dict[str, Selection] = {"estimate": by_own_weight, "twisted": by_reported_weight}


def mcl_h(
    robot: RobotModel,
    *,
    particles: int = 1000,
    lag: int = 20,
    beta: float = 10.0,
    form: str = "estimate",
    cell: float = 5.0,
    headings: int = 72,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return map-based MCL with a table of h_t over ``lag`` = L planned steps; else as there.

    Args:
        form: "estimate": h weights what is reported, the cloud is that of ``mcl_map``;
            "twisted": queues are resampled by it, too.
        cell: px between the nodes of the table.
        headings: of the table, round the circle.

    Raises:
        InputError: the robot's motion is not an ``OdometryMotion``.
    """
    if not isinstance(robot.motion, OdometryMotion):
        raise InputError(
            f"the robot's motion is a {type(robot.motion).__name__}, but the table of mcl-h is "
            "made for OdometryMotion: use mcl-pilots, which rolls out any motion."
        )
    selection = FORMS[one_of("form", form, FORMS)]
    base = mcl_map_smoother(
        robot,
        particles=particles,
        lag=lag,
        beta=beta,
        resampler=resampler,
        ess_threshold=ess_threshold,
    )
    grid = LookaheadGrid(
        floor_plan=robot.floor_plan,
        radius=robot.radius,
        beta=beta,
        motion=robot.motion,
        cell=cell,
        headings=headings,
    )
    return base.varied(lookahead=Tabulated(table=grid, steps=lag), selection=selection)


def mcl_pilots(
    robot: RobotModel,
    *,
    particles: int = 1000,
    lag: int = 20,
    beta: float = 10.0,
    pilots: int = 8,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return map-based MCL with h_t from rollouts over ``lag`` planned steps; else as ``mcl_h``.

    Args:
        pilots: K, fresh rollouts per particle and step.
    """
    base = mcl_map_smoother(
        robot,
        particles=particles,
        lag=lag,
        beta=beta,
        resampler=resampler,
        ess_threshold=ess_threshold,
    )
    rollout = base.filter.rollout
    pilots = integer("pilots", pilots, low=1)
    return base.varied(lookahead=Pilots(rollout=rollout, steps=lag, pilots=pilots))
