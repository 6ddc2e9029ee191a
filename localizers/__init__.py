"""Pluggable estimators of where a robot is: ``make("deq-mcl", RobotModel(...))``.

A localizer is given arrays (ranges, action, plan) and answers with a ``Belief``. It never sees the
world. Plug-ins inherit nothing: see ``Localizer``; ``resolve`` says by which names they are found,
``localizers.checks`` whether they keep the laws.
"""

from localizers.api import Belief, Localizer, Prior, RobotModel, mean_pose, quality_of
from localizers.beliefs import PointsBelief, PoseBelief
from localizers.clusters import Cluster, best_cluster
from localizers.models.beams import BeamModel, CensoredGaussianUniform, GaussianUniform
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior, UniformPrior
from localizers.naming.plugins import absolute_name
from localizers.naming.registry import make, names, parameters, register, resolve, source_digest

__all__ = [
    "BeamModel",
    "Belief",
    "CensoredGaussianUniform",
    "Cluster",
    "GaussianPrior",
    "GaussianUniform",
    "Localizer",
    "OdometryMotion",
    "PointsBelief",
    "PoseBelief",
    "Prior",
    "RobotModel",
    "UniformPrior",
    "absolute_name",
    "best_cluster",
    "make",
    "mean_pose",
    "names",
    "parameters",
    "quality_of",
    "register",
    "resolve",
    "source_digest",
]
