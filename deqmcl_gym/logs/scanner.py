"""Scanner: a lidar as mounted on a real robot."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.units import LENGTH
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, array, integer, number, one_of

_NAMES = ("angles", "mounting", "max_range", "min_range", "no_return", "sigma")
_EVEN = 1e-5  # rad: float32 angles of a LaserScan are no better


@final
@dataclass(frozen=True, kw_only=True)
class Scanner(Lidar):
    """A lidar with beams at any angles, and the meaning of its ranges, in the log's unit.

    A range is a measurement if it is in [min_range, max_range] and below ``no_return``. Other
    ranges are +inf in a record: nothing was in range, or the beam failed.

    Attributes:
        angles: of the beams against the robot's heading, including the turn of the mounting,
            counterclockwise, in the order of the ranges, (beams,) rad.
        min_range: smallest range that is a measurement.
        no_return: smallest range reported where nothing is in range.
    """

    beams: int = field(init=False)
    field_of_view: float = field(init=False)
    max_range: float = field(metadata=LENGTH)
    sigma: float = field(default=0.0, metadata=LENGTH)
    angles: tuple[float, ...] = field(repr=False)
    min_range: float = field(default=0.0, metadata=LENGTH)
    no_return: float = field(default=math.inf, metadata=LENGTH)

    def __post_init__(self) -> None:
        angles = array("scanner.angles", self.angles, (None,)).tolist()
        if not angles:
            raise InputError("scanner.angles is empty, but a scanner needs 1 beam or more.")
        span = max(angles) - min(angles)
        if span > 2 * math.pi + _EVEN:
            raise InputError(
                f"scanner.angles span {span:.4g} rad, but must span at most 2π: are they degrees?"
            )
        object.__setattr__(self, "angles", tuple(angles))
        object.__setattr__(self, "beams", len(angles))
        object.__setattr__(self, "field_of_view", min(span or 2 * math.pi, 2 * math.pi))
        super().__post_init__()
        number("scanner.min_range", self.min_range, low=0, high=self.max_range)
        least = self.min_range
        number("scanner.no_return", self.no_return, low=least, above=True, finite=False)

    @classmethod
    def of_lidar(cls, lidar: Lidar) -> "Scanner":
        """Return the scanner of a simulated robot, all of whose ranges are measurements."""
        return cls(
            angles=tuple(lidar.bearings),
            max_range=float(lidar.max_range),
            sigma=lidar.sigma,
            mounting=lidar.mounting,
        )

    @classmethod
    def of_json(cls, what: str, text: str) -> "Scanner":
        """Return the scanner that :attr:`json` describes; ``what`` names the text in messages.

        Raises:
            InputError: the text is not JSON, or has an unknown name or a bad value.
        """
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            values = None
        if not isinstance(values, dict) or not {"angles", "max_range"} <= values.keys():
            raise InputError(
                f"{what} is not a JSON object with a scanner's angles and max_range: give "
                '{"angles": [rad, …], "max_range": …}.'
            )
        for name in values:
            one_of(f"name in {what}", name, _NAMES)
        return cls(**values)

    @property
    def json(self) -> str:
        """This scanner as JSON without blanks."""
        values = {name: getattr(self, name) for name in _NAMES}
        return json.dumps(values, separators=(",", ":"))

    @property
    def bearings(self) -> Floats:
        """Angles of the beams against the robot's heading, (beams,) rad."""
        return np.array(self.angles)

    @property
    def spacing(self) -> float | None:
        """The angle between neighbouring beams; None if they are not evenly spaced."""
        if self.beams == 1:
            return 0.0
        step = (self.angles[-1] - self.angles[0]) / (self.beams - 1)
        even = self.angles[0] + step * np.arange(self.beams)
        return step if np.abs(even - self.bearings).max() <= _EVEN else None

    def measured(self, ranges: ArrayLike) -> Singles:
        """Return ranges (..., beams) as float32, +inf where they are not measurements."""
        with np.errstate(over="ignore", invalid="ignore"):
            given = np.array(ranges, dtype=np.float32)
            low, high = np.float32(self.min_range), np.float32(self.max_range)
            seen = (given >= low) & (given <= high) & (given < np.float32(self.no_return))
        given[~seen] = np.inf
        return given

    def thinned(self, max_beams: int) -> tuple["Scanner", Sequence[int]]:
        """Return the scanner with at most ``max_beams`` beams, spread evenly, and their indices.

        The first and the last beam are kept; a single beam is the middle one.
        """
        integer("max_beams", max_beams, low=1)
        if max_beams >= self.beams:
            return self, range(self.beams)
        ends = (0.0, self.beams - 1.0) if max_beams > 1 else ((self.beams - 1) / 2,) * 2
        kept = np.rint(np.linspace(*ends, max_beams)).astype(int).tolist()
        return replace(self, angles=tuple(self.angles[i] for i in kept)), kept
