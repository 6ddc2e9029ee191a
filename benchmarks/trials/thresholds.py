"""Thresholds: from when on a step is far off, and a trial lost. A part of a scenario."""

from dataclasses import dataclass, field

from deqmcl_gym.maps.units import LENGTH
from deqmcl_gym.validation import integer, number


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What counts as far off and as lost, in the unit of the scenario's map.

    Attributes:
        far: error e above which a step is far off.
        lost: a trial is lost if its mean position error is above this over …
        lost_steps: … its last states, as many as this.
    """

    far: float = field(default=50.0, metadata=LENGTH)
    lost: float = field(default=50.0, metadata=LENGTH)
    lost_steps: int = 20

    def __post_init__(self) -> None:
        number("thresholds.far", self.far, low=0)
        number("thresholds.lost", self.lost, low=0)
        integer("thresholds.lost_steps", self.lost_steps, low=1)
