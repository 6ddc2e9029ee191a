"""Pluggable estimators of where a robot is: ``make("deq-mcl", RobotModel(...))``.

A localizer is given arrays (ranges, action, plan) and answers with a ``Belief``. It never sees the
world. Plug-ins inherit nothing: see ``Localizer``.
"""

from localizers.api import Belief, Localizer, Prior, RobotModel, mean_pose
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior
from localizers.models.scan import BeamModel, CensoredGaussianUniform, GaussianUniform
from localizers.registry import make, names, parameters, register

__all__ = [
    "BeamModel",
    "Belief",
    "CensoredGaussianUniform",
    "GaussianPrior",
    "GaussianUniform",
    "Localizer",
    "OdometryMotion",
    "Prior",
    "RobotModel",
    "make",
    "mean_pose",
    "names",
    "parameters",
    "register",
]
