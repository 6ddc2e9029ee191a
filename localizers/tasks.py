"""The tasks of acting, ready to use: what ``gym.make`` makes of ``Localize-v0`` and ``Track-v0``.

Here the envs of ``deqmcl_gym.envs.acting`` get a localizer, by name, that assumes the world's own
noise, and the prior from which the start is drawn. No localizer imports this.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from deqmcl_gym.envs.acting import LocalizeEnv, Site, Sites, TrackEnv
from deqmcl_gym.maps.map import metre
from deqmcl_gym.validation import InputError, one_of, shown
from deqmcl_gym.world import WORLDS, World, extent_of, offices_of
from localizers.api import Localizer
from localizers.models import RobotModel
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior, UniformPrior
from localizers.models.range_table import RangeTable
from localizers.models.scan import CensoredGaussianUniform
from localizers.registry import make, parameters

OFFICE = {"wings": 1, "corridors": 2}  # 24 m × 26 m
BEAM_POWER = 0.1  # the beams of one scan tell as much as 1.6 independent ones
_LOST: dict[str, Any] = {
    "floor_plan": {"office": OFFICE},
    "lidar": {"beams": 16, "field_of_view": 2 * math.pi, "max_range": 12.0, "sigma": 0.5},
    "robot": {"radius": 0.25, "max_distance": 0.2, "max_turn": math.pi / 4},
    "noise": {"drive": 0.1, "turn": 0.1, "drift": 0.1},
}
_BLIND: dict[str, Any] = {
    "lidar": {"beams": 16, "field_of_view": 2 * math.pi, "sigma": 10.0},
    "noise": {"drive": 0.1, "turn": 0.1, "drift": 0.01},
}
_CELL = 0.2  # m, of the table of ranges
_SD_POSITION, _SD_HEADING = 5.0, 0.1  # px, rad: of what is known of the start


class Localize(LocalizeEnv):
    """An office in which the robot may be anywhere; see ``LocalizeEnv``.

    Args:
        localizer: a name of ``localizers.make``, or {"name": …} with parameters; ``particles`` is
            10,000 unless given. It assumes the world's noise, and beams to the power of 0.1.
        scan: "beams" casts the rays of each particle; "table" looks them up in a table of
            cells and directions, which is much faster: for training.
        floor_plan: as for ``Room-v0``; None: an office of 24 m × 26 m.
        lidar: changes to 16 beams all round that reach 12 m, with a noise of 0.5 m.
        robot: changes to that of the scenario ``lost``.
        noise: changes to that of the scenario ``lost``.
        task: the arguments of ``LocalizeEnv``.
    """

    def __init__(
        self,
        *,
        localizer: str | dict[str, Any] = "mcl-map",
        scan: str = "beams",
        floor_plan: Any = None,
        lidar: Any = None,
        robot: Any = None,
        noise: Any = None,
        **task: Any,
    ) -> None:
        one_of("scan", scan, ("beams", "table"))
        world = partial(_world, _LOST, lidar=lidar, robot=robot, noise=noise)
        site = partial(_lost, localizer, world, by_table=scan == "table")
        super().__init__(_sites(site, floor_plan), **task)


class Track(TrackEnv):
    """A room in which the robot drives to a goal, and scans cost; see ``TrackEnv``.

    Args:
        localizer: as for ``Localize``, with 500 particles unless given.
        floor_plan: as for ``Localize``; None: the room of ``Room-v0``.
        lidar: changes to 16 beams all round, with a noise of 10 px.
        robot: changes to the robot of ``Room-v0``.
        noise: changes to a noise that blurs the belief within a few steps.
        task: the arguments of ``TrackEnv``.
    """

    def __init__(
        self,
        *,
        localizer: str | dict[str, Any] = "mcl-map",
        floor_plan: Any = None,
        lidar: Any = None,
        robot: Any = None,
        noise: Any = None,
        **task: Any,
    ) -> None:
        world = partial(_world, _BLIND, lidar=lidar, robot=robot, noise=noise)
        sites = _sites(partial(_blind, localizer, world), floor_plan)
        px = (sites.site(sites.offices.seeds[0]) if isinstance(sites, Sites) else sites).world.pixel
        around = partial(GaussianPrior, sd_position=_SD_POSITION * px, sd_heading=_SD_HEADING)
        lengths = {"tolerance": 40.0 * px, "least": 150.0 * px}
        super().__init__(sites, around, **{**lengths, **task})


def _sites(site: Callable[[Any], Site], floor_plan: Any) -> Site | Sites:
    """Return the site in a floor plan, or the sites in offices of a range of seeds."""
    offices = offices_of(floor_plan)
    return site(floor_plan) if offices is None else Sites(offices, site)


def _lost(
    localizer: Any, world_in: Callable[[Any], World], floor_plan: Any, *, by_table: bool
) -> Site:
    world = world_in(floor_plan)
    model = robot_model(world, BEAM_POWER)
    if by_table:
        beam = CensoredGaussianUniform(sigma=world.lidar.sigma, power=BEAM_POWER)
        cell = _CELL * metre(world.floor_plan.unit)
        model = replace(model, scan=RangeTable(beam=beam, cell=cell))
    made = _localizer(localizer, model, particles=10_000)
    anywhere = UniformPrior(floor_plan=world.floor_plan, radius=world.body + world.skin)
    extent = extent_of(floor_plan or _LOST["floor_plan"], world.floor_plan)
    return Site(world, made, anywhere, extent)


def _blind(localizer: Any, world_in: Callable[[Any], World], floor_plan: Any) -> Site:
    world = world_in(floor_plan)
    made = _localizer(localizer, robot_model(world), particles=500)
    anywhere = UniformPrior(floor_plan=world.floor_plan, radius=world.body + 4 * world.pixel)
    return Site(world, made, anywhere, extent_of(floor_plan, world.floor_plan))


def _world(base: dict[str, Any], floor_plan: Any, **parts: Any) -> World:
    """Return the paper's world with the task's parts, then those given."""
    world = WORLDS["paper"].changed(**base)
    if floor_plan is not None:
        world = world.changed(floor_plan=floor_plan)
    return world.changed(**parts)


def robot_model(world: World, power: float = 1.0) -> RobotModel:
    """Return the robot of a world, its noise known; ``power`` tempers the beams."""
    return RobotModel(
        floor_plan=world.floor_plan,
        lidar=world.lidar,
        radius=world.robot.radius,
        motion=OdometryMotion(**vars(world.noise)),
        scan=CensoredGaussianUniform(sigma=world.lidar.sigma, power=power),
    )


def _localizer(given: str | dict[str, Any], robot: RobotModel, **defaults: Any) -> Localizer:
    """Return a localizer by name, or by name and parameters."""
    params = {"name": given} if isinstance(given, str) else dict(given)
    if not isinstance(name := params.pop("name", None), str):
        raise InputError(
            f"localizer is {shown(given)}, but must be a name, or a mapping with a name and "
            'parameters, such as {"name": "mcl-map", "particles": 5000}.'
        )
    accepted = parameters(name) or ()
    return make(name, robot, **{k: v for k, v in defaults.items() if k in accepted} | params)
