"""What the filters assume of each named world. The worlds themselves: ``deqmcl_gym.world.presets``.

Nothing of the paper's setting but room, L, β and the number of trials is published. ``paper`` was
chosen by the plain MCL row of its Table 1 alone: large assumed noise, a weak sensor, a local start.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.validation import number, one_of
from localizers import (
    CensoredGaussianUniform,
    GaussianPrior,
    GaussianUniform,
    OdometryMotion,
    RobotModel,
)
from localizers.models.beams import BeamDensity


@dataclass(frozen=True, kw_only=True)
class Assumptions:
    """Assumed noise and prior knowledge of the start, which is N(start of the lap, …)."""

    motion: OdometryMotion = field(default_factory=OdometryMotion)
    scan: BeamDensity = field(default_factory=GaussianUniform)
    start_sd_position: float = 10.0
    start_sd_heading: float = 0.1

    def __post_init__(self) -> None:
        number("start_sd_position", self.start_sd_position, low=0)
        number("start_sd_heading", self.start_sd_heading, low=0)

    def changed(self, values: Mapping[str, Any]) -> "Assumptions":
        """Return these with some values changed, by dotted name: {"scan.sigma": 50.0}.

        Raises:
            InputError: unknown name or a bad value.
        """
        changed = self
        for name, value in values.items():
            part, _, key = one_of("assumption", name, self._names()).partition(".")
            new = replace(getattr(changed, part), **{key: value}) if key else value
            changed = replace(changed, **{part: new})
        return changed

    def _names(self) -> list[str]:
        parts = {own.name: getattr(self, own.name) for own in fields(self)}
        return [
            name
            for part, value in parts.items()
            for name in (
                [f"{part}.{own.name}" for own in fields(value)] if is_dataclass(value) else [part]
            )
        ]

    def robot_model(self, room: RoomEnv) -> RobotModel:
        """Return what localizers are made for: the room's map and lidar with this noise."""
        return RobotModel(
            floor_plan=room.floor_plan,
            lidar=room.lidar,
            radius=room.world.robot.radius,
            motion=self.motion,
            scan=self.scan,
        )

    def prior(self, room: RoomEnv) -> GaussianPrior:
        """Return p(x_0); centred on the planned start, not on the truth."""
        return GaussianPrior(
            mean=room.course.start,
            sd_position=self.start_sd_position,
            sd_heading=self.start_sd_heading,
        )


ASSUMED = MappingProxyType(
    {
        # ten times the world's noise and more
        "paper": Assumptions(),
        # the world's noise, sensor and start, but for the uniform share of the beams
        "matched": Assumptions(
            motion=OdometryMotion(drive=0.02, turn=0.02, drift=0.0005),
            scan=CensoredGaussianUniform(sigma=100.0),
        ),
        # five times the world's motion noise (drift: twenty times), its sensor but for that share
        "sharp": Assumptions(
            motion=OdometryMotion(drive=0.1, turn=0.1, drift=0.01),
            scan=CensoredGaussianUniform(sigma=5.0),
        ),
        # the world's noise, sensor and start, but for the uniform share of the beams
        "guided": Assumptions(
            motion=OdometryMotion(drive=0.2, turn=0.2, drift=0.02),
            scan=CensoredGaussianUniform(sigma=100.0),
            start_sd_position=5.0,
            start_sd_heading=0.05,
        ),
    }
)
