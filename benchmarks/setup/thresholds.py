"""When an estimate counts as far off, and a robot as lost."""

from dataclasses import dataclass, field

from deqmcl_gym.maps.map import LENGTH
from deqmcl_gym.validation import integer, number


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What the scores count as far off, and as lost.

    Attributes:
        far: position error above which an estimate is far off, px.
        lost: mean position error of the last steps above which a trial is lost, px.
        lost_steps: how many steps these are.
    """

    far: float = field(default=50.0, metadata=LENGTH)
    lost: float = field(default=50.0, metadata=LENGTH)
    lost_steps: int = 20

    def __post_init__(self) -> None:
        number("thresholds.far", self.far, low=0, above=True)
        number("thresholds.lost", self.lost, low=0, above=True)
        integer("thresholds.lost_steps", self.lost_steps, low=1)
