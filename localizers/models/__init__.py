"""What a localizer knows of the robot: its map, its sensor, and the noise that is assumed.

In the other files: models of its start, its motion and its scans, and which steps are feasible.
"""

from dataclasses import dataclass, field

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import LENGTH, pixel
from deqmcl_gym.validation import InputError, number, shown
from localizers.api import Motion
from localizers.models.motion import OdometryMotion
from localizers.models.nav2_motion import unknown_motion
from localizers.models.scan import (
    METRE_SIGMA,
    BeamDensity,
    GaussianUniform,
    LidarScan,
    ScanModel,
    ScanSource,
)

_COARSEST = 0.1  # px: the largest spacing of float32 poses that is allowed


@dataclass(frozen=True, kw_only=True)
class RobotModel:
    """The robot as a localizer knows it: its map, its sensor and the assumed noise."""

    floor_plan: Map
    lidar: Lidar
    #: of the robot's disc, in the map's unit; None is 8 px, or 0.16 m
    radius: float = field(default=None, metadata=LENGTH)  # type: ignore[assignment]
    #: p(x_t | x_{t-1}, a_t); None is ``OdometryMotion``'s default, or on a map in metres that of
    #: ``DifferentialMotion``
    motion: Motion = None  # type: ignore[assignment]
    #: p(o | ô) of one beam; None is ``GaussianUniform``'s default, or with σ = 0.2 m, as Nav2's
    #: sigma_hit. Or what makes a model of whole scans, such as ``ScanPlugIn``.
    scan: BeamDensity | ScanSource = None  # type: ignore[assignment]
    #: β ≥ 0 of methods that are given none; a step that collides on the map, carried out or
    #: planned, is charged exp(-β)
    beta: float = 10.0

    def __post_init__(self) -> None:
        for name, kind, has in (("floor_plan", "Map", "unit"), ("lidar", "Lidar", "max_range")):
            if not hasattr(value := getattr(self, name), has):
                raise InputError(
                    f"{name} is {shown(value)}, but must be a {kind}, such as an env's."
                )
        if self.radius is None:
            object.__setattr__(self, "radius", 8 * pixel(self.floor_plan.unit))
        metres = self.floor_plan.unit == "m"
        if self.motion is None:
            motion = unknown_motion("differential", "m") if metres else OdometryMotion()
            object.__setattr__(self, "motion", motion)
        if self.scan is None:
            scan = GaussianUniform(sigma=METRE_SIGMA) if metres else GaussianUniform()
            object.__setattr__(self, "scan", scan)
        number("radius", self.radius, low=0)
        number("beta", self.beta, low=0, finite=False)
        farthest = max(map(abs, self.floor_plan.bounds))
        coarse = float(np.spacing(np.float32(farthest)))
        if coarse > _COARSEST * pixel(self.floor_plan.unit):
            unit = self.floor_plan.unit
            raise InputError(
                f"the floor plan reaches to {farthest:g} {unit}, where the float32 poses of a "
                f"localizer are {coarse:g} {unit} apart: move it towards (0, 0)."
            )

    def scan_model(self) -> ScanModel:
        """Return p(o_t | x_t, m) of whole scans, made for the map and the lidar."""
        if isinstance(self.scan, ScanSource):
            return self.scan.made(self.floor_plan, self.lidar)
        return self.beam_scan("scan_model")

    def beam_scan(self, asked_by: str) -> LidarScan:
        """Return the scan model, a product over beams; refuse one of whole scans to who asks."""
        if isinstance(self.scan, ScanSource):
            raise InputError(
                f"{asked_by} looks at single beams, but the scan model {self.scan} tells only of "
                "whole scans: use a particle filter without a beam_filter, or another scan model."
            )
        return LidarScan(floor_plan=self.floor_plan, lidar=self.lidar, beam=self.scan)
