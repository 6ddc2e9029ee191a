"""Pluggable estimators of a robot's pose: ``make("deq-mcl", RobotModel(...))``.

A localizer receives arrays (ranges, action, plan) and returns a ``Belief``; it never sees the
world. Plug-ins need no base class: see ``Localizer``. ``resolve`` documents how they are named;
``localizers.checks`` tests whether they keep the laws.
"""

from localizers.api import (
    Belief,
    Cluster,
    Localizer,
    PointsBelief,
    PoseBelief,
    Prior,
    best_cluster,
    mean_pose,
    quality_of,
)
from localizers.calibration import Calibration
from localizers.inference.hedge import hedged
from localizers.kinds import absolute_name
from localizers.models import RobotModel
from localizers.models.feasibility import PlanSensor
from localizers.models.motion import OdometryMotion
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion
from localizers.models.prior import (
    AnnulusRegion,
    GaussianPrior,
    MixturePrior,
    PolygonRegion,
    UniformPrior,
)
from localizers.models.scan import (
    BeamModel,
    CensoredGaussianUniform,
    GaussianUniform,
    LatentShare,
    Scan,
)
from localizers.recovery import Relocalization
from localizers.registry import (
    ScanPlugIn,
    describe,
    make,
    names,
    parameters,
    register,
    registered,
    resolve,
    source_digest,
)
from localizers.tracker import Estimate, Tracker

__all__ = [
    "AnnulusRegion",
    "BeamModel",
    "Belief",
    "Calibration",
    "CensoredGaussianUniform",
    "Cluster",
    "DifferentialMotion",
    "Estimate",
    "GaussianPrior",
    "GaussianUniform",
    "LatentShare",
    "Localizer",
    "MixturePrior",
    "OdometryMotion",
    "OmniMotion",
    "PlanSensor",
    "PointsBelief",
    "PolygonRegion",
    "PoseBelief",
    "Prior",
    "Relocalization",
    "RobotModel",
    "Scan",
    "ScanPlugIn",
    "Tracker",
    "UniformPrior",
    "absolute_name",
    "best_cluster",
    "describe",
    "hedged",
    "make",
    "mean_pose",
    "names",
    "parameters",
    "quality_of",
    "register",
    "registered",
    "resolve",
    "source_digest",
]
