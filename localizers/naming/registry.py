"""Names that ``localizers.checks`` still asks for here."""

from typing import Any

from localizers.api import Localizer
from localizers.kinds import parameters_of
from localizers.models.robot import RobotModel
from localizers.registry import LOCALIZER, Factory

is_plug_in, is_registered, resolve = (
    LOCALIZER.is_plug_in,
    LOCALIZER.is_registered,
    LOCALIZER.resolve,
)
__all__ = ["Factory", "is_plug_in", "is_registered", "made_by", "parameters_of", "resolve"]


def made_by(factory: Factory, name: str, robot: RobotModel, **params: Any) -> Localizer:
    """Return what a factory makes if it is a localizer, else raise; ``name`` is for the error."""
    made: Localizer = LOCALIZER.checked(name, factory(robot, **params))
    return made
