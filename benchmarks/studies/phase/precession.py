"""Phase precession as numbers: the slope of phase over position, and how right each part is."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.phase.cycles import Cycles
from benchmarks.tables.table_1 import TITLES
from deqmcl_gym.numerics.types import Floats

PERFECT = "perfect queue"


@dataclass(frozen=True, kw_only=True)
class Precession:
    """What the fields of a lap do; NaN is not available.

    Attributes:
        first, last: least and greatest phase at which a field is active, degrees.
        slope: degrees per unit of length, negative if fields fire earlier as the robot goes on;
            NaN of one phase.
        correlation: of phase and position, weighted by activity.
        late: where the line is at 180°, so far past the centre; of one phase: the mean position.
        past, present, future: mean mass in the field where the robot truly is at that state.
    """

    first: float = math.nan
    last: float = math.nan
    slope: float = math.nan
    correlation: float = math.nan
    late: float = math.nan
    past: float
    present: float
    future: float


def precession(cycles: Cycles) -> Precession:
    """Measure precession over all fields and steps of a lap.

    With activity as the weight of each (step, offset, field), the positions u (of the robot, past
    the field's centre) are regressed on the phases φ: slope = 1 / (Cov(u, φ) / Var φ). This way
    round nothing is cut off: at each phase the whole pass through the field is seen, whereas at a
    given position only some of the phases that belong to it lie between 0° and 360°.
    """
    past, present, future = (
        _mean(cycles.right[:, np.sign(cycles.offsets) == sign]) for sign in (-1, 0, 1)
    )
    return Precession(**_line(cycles), past=past, present=present, future=future)


def _line(cycles: Cycles) -> dict[str, float]:
    """Regress position on phase."""
    activity = np.nan_to_num(cycles.activity)
    active = cycles.phases[activity.any(axis=(0, 2))]
    if not active.size:
        return {}
    share = activity / activity.sum()
    over_phase = share.sum(axis=(0, 2))
    centre, position = (over_phase * cycles.phases).sum(), (share * cycles.passed).sum()
    line = {"first": active[0], "last": active[-1], "late": position}
    off_phase, off_place = cycles.phases - centre, cycles.passed - position
    covariance = ((share * off_place).sum(axis=(0, 2)) * off_phase).sum()
    if active.size > 1 and covariance:
        of_phase, of_place = (over_phase * off_phase**2).sum(), (share * off_place**2).sum()
        line["slope"] = slope = of_phase / covariance
        line["correlation"] = covariance / math.sqrt(of_phase * of_place)
        line["late"] += (180 - centre) / slope
    return {name: float(value) for name, value in line.items()}


def _mean(values: Floats) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else math.nan


@dataclass(frozen=True)
class Lap:
    """The lap of a localizer, or of the perfect queue, under its name."""

    name: str
    cycles: Cycles

    @property
    def title(self) -> str:
        """Its name in words."""
        title = TITLES.get(self.name, self.name)
        return title[:1].upper() + title[1:]

    @cached_property
    def precession(self) -> Precession:
        """Measured on it."""
        return precession(self.cycles)

    @property
    def words(self) -> str:
        """Its precession in a few words."""
        found = self.precession
        if math.isnan(found.first):
            return "no field is active"
        if math.isnan(found.slope):
            return f"fires at {found.first:.0f}° only, no precession"
        return f"fires from {found.first:.0f}° to {found.last:.0f}°"
