"""The localizers by name: which are built in, and how one of any name is made."""

from collections.abc import Callable
from typing import Any

from localizers.api import Localizer
from localizers.kinds import Kind
from localizers.methods.amcl import amcl
from localizers.methods.cbgl import cbgl
from localizers.methods.dead_reckoning import dead_reckoning
from localizers.methods.deq_mcl import deq_mcl, mcl, mcl_map, mcl_map_smoother, mcl_smoother
from localizers.methods.ekf import ekf
from localizers.methods.grid import grid
from localizers.methods.plan_aware import deq_mcl_fresh, mcl_plan, mcl_plan_hedged
from localizers.models.robot import RobotModel

Factory = Callable[..., Localizer]

LOCALIZER = Kind(
    word="localizer",
    call="NAME(robot, **params)",
    verbs=("reset(prior, plan, rng)", "update(ranges, action, plan)"),
    group="deqmcl.localizers",
    builtin={
        "mcl": mcl,
        "mcl-smoother": mcl_smoother,
        "mcl-map": mcl_map,
        "mcl-map-smoother": mcl_map_smoother,
        "deq-mcl": deq_mcl,
        "deq-mcl-fresh": deq_mcl_fresh,
        "mcl-plan": mcl_plan,
        "mcl-plan-hedged": mcl_plan_hedged,
        "dead-reckoning": dead_reckoning,
        "grid": grid,
        "amcl": amcl,
        "cbgl": cbgl,
        "ekf": ekf,
    },
    gone={
        "mcl-h": "use deq-mcl-fresh, which has its error.",
        "mcl-pilots": "use deq-mcl-fresh, which has its numbers.",
        "deq-mcl-rejuvenated": "use deq-mcl-fresh.",
    },
)
names, parameters, register = LOCALIZER.names, LOCALIZER.parameters, LOCALIZER.register
registered = LOCALIZER.registered
resolve: Callable[[str], Factory] = LOCALIZER.resolve


def make(name: str, robot: RobotModel, **params: Any) -> Localizer:
    """Make a localizer.

    Args:
        name: see ``localizers.kinds``.
        robot: its map, its sensor and the assumed noise.
        params: parameters of the method, see ``parameters(name)``.

    Raises:
        InputError: unknown name or parameter (the nearest valid one is named), a bad value, or a
            plug-in that fails or makes something without ``reset`` or ``update``.
    """
    made: Localizer = LOCALIZER.make(name, params, robot)
    return made


def source_digest(name: str) -> str | None:
    """Digest of a plug-in, see ``Kind.digest``; None of a built-in localizer, or of none."""
    return LOCALIZER.digest(name) or None
