"""Phase precession as numbers: the slope of phase over position, and how right each part is."""

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.phase.cycles import Cycles
from deqmcl_gym.numerics.types import Floats


@dataclass(frozen=True, kw_only=True)
class Precession:
    """What the fields of a lap do; NaN is not available.

    Attributes:
        first, last: least and greatest phase at which a field is active, degrees.
        slope: degrees per px, negative if fields fire earlier as the robot goes on; NaN of one
            phase.
        correlation: of phase and position, weighted by activity.
        position, centre: mean of position, px, and of phase, degrees: the line goes through them.
        past, present, future: mean mass in the field where the robot truly is at that state.
    """

    first: float
    last: float
    slope: float
    correlation: float
    position: float
    centre: float
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
    line = _line(np.nan_to_num(cycles.activity), cycles.phases, np.nan_to_num(cycles.passed()))
    right = right_mass(cycles)
    signs = np.sign(cycles.offsets)
    return Precession(
        **line,
        past=_mean(right[:, signs < 0]),
        present=_mean(right[:, signs == 0]),
        future=_mean(right[:, signs > 0]),
    )


def _line(weight: Floats, phases: Floats, passed: Floats) -> dict[str, float]:
    """Regress position (T + 1, 2R + 1, fields) on phase (2R + 1,); weights as positions."""
    line = dict.fromkeys(("first", "last", "slope", "correlation", "position", "centre"), math.nan)
    active = weight.any(axis=(0, 2))
    if not active.any():
        return line
    line["first"], line["last"] = phases[active][[0, -1]].tolist()
    share = weight / weight.sum()
    over_phase = share.sum(axis=(0, 2))
    line["centre"] = centre = float((over_phase * phases).sum())
    line["position"] = position = float((share * passed).sum())
    if active.sum() < 2:
        return line
    off_phase, off_place = phases - centre, passed - position
    covariance = float(((share * off_place).sum(axis=(0, 2)) * off_phase).sum())
    spread_phase = float((over_phase * np.square(off_phase)).sum())
    spread_place = float((share * np.square(off_place)).sum())
    if covariance:
        line["slope"] = spread_phase / covariance
        line["correlation"] = covariance / math.sqrt(spread_phase * spread_place)
    return line


def right_mass(cycles: Cycles) -> Floats:
    """Mass in the field where the robot truly is at t + k, (T + 1, 2R + 1); NaN if in none."""
    right = np.full(cycles.error.shape, np.nan)
    for column, k in enumerate(cycles.offsets.tolist()):
        steps = np.arange(max(0, -k), cycles.steps + 1 - max(0, k))
        homes = cycles.home[steps + k]
        inside = homes >= 0
        right[steps[inside], column] = cycles.activity[steps[inside], column, homes[inside]]
    return right


def _mean(values: Floats) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else math.nan
