"""The built-in scenarios, in reading order; those on logs are in ``benchmarks.setup.logs``.

Nothing of the paper's setting but room, L, β and the number of trials is published. ``paper`` was
chosen by the plain MCL row of its Table 1 alone: large assumed noise, a weak sensor, a local start.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from benchmarks.setup.overrides import Named, Overrides
from benchmarks.setup.priors import Gaussian, Uniform
from benchmarks.setup.scenario import RoomScenario, Thresholds
from deqmcl_gym.world.config import MotionNoise, Start, World
from deqmcl_gym.world.presets import WORLDS
from localizers import CensoredGaussianUniform, OdometryMotion


def _sensor(sigma: float) -> CensoredGaussianUniform:
    """The world's beams, but for a uniform share of them."""
    return CensoredGaussianUniform(sigma=sigma)


def _around(start: Start) -> Gaussian:
    """The prior from which the world draws its start."""
    return Gaussian(sd_position=start.sd_position, sd_heading=start.sd_heading)


def _known(world: World) -> dict[str, Any]:
    """All that filters assume is as it is in a world."""
    motion, scan = OdometryMotion(**vars(world.noise)), _sensor(world.lidar.sigma)
    return {"motion": motion, "scan": scan, "prior": _around(world.start)}


def _as(base: RoomScenario, words: str, agent: str | None = None, **parts: Any) -> RoomScenario:
    """Another scenario, with another agent or other parts of its world."""
    driven = Named(agent) if agent else base.agent
    return replace(base.in_world(Overrides(parts)), words=words, agent=driven)


_GUIDED = RoomScenario(
    words="large motion noise, and a driver who sees the true pose; the filters know the noise",
    world=WORLDS["guided"],
    **_known(WORLDS["guided"]),
)
_NOISE = MotionNoise(drive=0.1, turn=0.1, drift=0.1)  # per m
_FAN = {"beams": 16, "field_of_view": 2 * math.pi, "max_range": 12.0, "sigma": 0.5}
_BEAM = {"beams": 1, "field_of_view": math.pi / 2, "max_range": 12.0, "sigma": 1.0}
_START = Start(sd_position=0.1, sd_heading=0.1)
_LOST = RoomScenario(
    words="16 beams in an office building; a dispatcher's route, and no idea of the start",
    world=WORLDS["paper"],
    motion=OdometryMotion(**vars(_NOISE)),
    scan=_sensor(_FAN["sigma"]),
    prior=Uniform(),
    thresholds=Thresholds(far=1.0, lost=1.0),
    buildings=20,
).in_world(
    Overrides(
        {
            "floor_plan": {"office": {"wings": 2, "corridors": 2}},
            "lidar": _FAN,
            "robot.radius": 0.25,
            "noise": _NOISE,
            "lap.step": 0.2,
            "route": {"min_length": 20.0, "max_length": 60.0},
            "driver": {},
        }
    )
)
_SYMMETRIC = _as(
    _LOST,
    "as lost, but both wings are alike and beams short; only one fits the route",
    floor_plan={"office": {"wings": 2, "corridors": 1, "repeated": True}},
    lidar={**_FAN, "max_range": 5.0},
    # longer than any way within a wing of at most 24 m by 16 m: so it leaves through the middle
    route={"min_length": 36.0, "max_length": 60.0},
)
_KIDNAPPED = replace(
    _as(
        _LOST,
        "as lost, but carried elsewhere before step 75; the dispatcher plans from there",
        route={"min_length": 30.0, "max_length": 60.0},
    ),
    disturbance=(Overrides({"kind": "kidnap", "step": 75}),),
)
_DRIVING = replace(
    _as(
        _LOST,
        "16 beams in an office building; planned and driven to a goal on the estimate",
        agent="to-goal",
        start=_START,
    ),
    prior=_around(_START),
)
_SEARCHING = replace(
    _as(
        _LOST,
        "lost in a small office building, without a route: who drives looks for where it is",
        agent="wall-follower",
        floor_plan={"office": {"wings": 1, "corridors": 2}},
        route={"min_length": 12.0, "max_length": 20.0},  # an episode has twice its steps
    ),
    scan=replace(_sensor(_FAN["sigma"]), power=0.1),  # as in Localize-v0
)
_WRONG: dict[str, Any] = {
    "clutter": {"number": 40},
    "changed_walls": {"share": 0.3},
    "people": {"number": 20},
}

SCENARIOS: Mapping[str, RoomScenario] = MappingProxyType(
    {
        "paper": RoomScenario(
            words="one weak beam; the filters assume ten times the true motion noise or more",
            world=WORLDS["paper"],
        ),
        "matched": RoomScenario(  # where calibration is judged
            words="one weak beam; the filters know the true noise, sensor and start",
            world=WORLDS["matched"],
            **_known(WORLDS["matched"]),
        ),
        "sharp": RoomScenario(
            words="nine sharp beams; the filters assume five times the motion noise (drift: twenty "
            "times)",
            world=WORLDS["sharp"],
            motion=OdometryMotion(drive=0.1, turn=0.1, drift=0.01),
            scan=_sensor(WORLDS["sharp"].lidar.sigma),
        ),
        "guided": _GUIDED,
        "guided-before": _as(
            _GUIDED,
            "one weak beam and large noise; a lap planned before the start is driven as it is",
            driver="none",
        ),
        "guided-estimate": _as(
            _GUIDED,
            "as guided, but driven and planned from the localizer's own estimate",
            agent="on-estimate",
        ),
        "guided-stale": _as(
            _GUIDED,
            "as guided, but the localizer is shown the plan of another start",
            agent="stale",
        ),
        "lost": _LOST,
        "lost-wrong-route": _as(
            _LOST,
            "as lost, but the localizer is shown the route of another robot in the building",
            agent="other-route",
        ),
        "lost-weak": replace(
            _as(_LOST, "as lost, with one weak beam ahead", lidar=_BEAM),
            scan=_sensor(_BEAM["sigma"]),
        ),
        "lost-symmetric": _SYMMETRIC,
        "lost-symmetric-route": _as(
            _SYMMETRIC,
            "as lost-symmetric, but a half turn gives the same building: both fit the route",
            floor_plan={"office": {"wings": 2, "corridors": 1, "symmetric": True}},
        ),
        "searching": _SEARCHING,
        "kidnapped": _KIDNAPPED,
        "kidnapped-stale": _as(
            _KIDNAPPED,
            "as kidnapped, driven alike; but the localizer is shown what is left of the old plan",
            agent="old-route",
        ),
        "wrong-map": replace(
            _as(
                _LOST,
                "the start is known, but not 40 things, 30 % of the inner walls and 20 people",
                start=_START,
                **_WRONG,
            ),
            prior=_around(_START),
        ),
        "wrong-map-lost": _as(
            _LOST, "as lost, where the map lacks the same as in wrong-map", **_WRONG
        ),
        "driving": _DRIVING,
        "driving-route": _as(
            _DRIVING,
            "as driving, on the route of a dispatcher who knew the start",
            agent="on-route",
        ),
        "driving-perfect": _as(
            _DRIVING, "as driving, but driven from the true pose", agent="open-loop"
        ),
        "driving-blind": _as(
            _DRIVING,
            "as driving, but the plan made before the start is driven as it is",
            agent="open-loop",
            driver="none",
        ),
    }
)
