"""How well scans fit a map, and the warning where they do not: another floor, another scale."""

import math

import numpy as np

from benchmarks.replay.setting import Setting, metre
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats
from localizers import OmniMotion

AGREE = (0.1, 0.3)  # m that a beam may be off
FEW = 0.5  # share of beams within the larger one below which log and map do not fit
SIDEWAYS = 0.1  # share of the way above which sideways motion is told; 1 to 2 % in two real logs
_LOOKED_AT = 200  # reference poses


def agreement(log: Log, floor_plan: Map, poses: Floats) -> tuple[float, float]:
    """Share of the beams with a return that are within 0.1 m and 0.3 m of what the map says.

    Args:
        log: n records.
        floor_plan: the map.
        poses: assumed for each scan, (n, 3).
    """
    origins = log.scanner.origins(poses.T).T
    expected = floor_plan.ranges(origins, log.scanner.bearings)
    seen = np.isfinite(log.ranges)
    with np.errstate(invalid="ignore"):
        off = np.abs(expected - log.ranges)[seen] / metre(log)
    within, well = ((off <= most).mean() if off.size else math.nan for most in AGREE)
    return float(within), float(well)


def disagreement(setting: Setting) -> str | None:
    """Return the warning that log and map do not fit, by the reference; None if they do."""
    known = setting.log.referenced
    if not known.size:
        return None
    looked = known[np.unique(np.linspace(0, known.size - 1, _LOOKED_AT).astype(np.intp))]
    part = setting.log.of_records(looked)
    assert part.reference is not None
    floor_plan = setting.env().floor_plan
    _, share = agreement(part, floor_plan, part.reference)
    return misfit_words(share, "from the reference poses")


def sideways(setting: Setting) -> str | None:
    """Return the warning that the odometry moves the robot sideways; None if it hardly does."""
    log = setting.log
    aside, driven = float(np.abs(log.residuals).sum()), float(log.driven[-1])
    if isinstance(setting.motion, OmniMotion) or aside <= SIDEWAYS * driven:
        return None
    return (
        f"{aside:.1f} of {driven:.1f} {log.unit} of odometry are sideways: for a robot that can "
        "move so, add --motion kind=omni; for one that cannot, its odometry is not of the point "
        "between its wheels, or the wheels slip."
    )


def misfit_words(share: float, where: str) -> str | None:
    """Return the warning for a share of beams that agree with the map; None if they are enough."""
    if math.isnan(share):
        return (
            "no beam has a measurement: every range is beyond max_range or not a number; check "
            "that ranges and max_range are in m."
        )
    if share >= FEW:
        return None
    return (
        f"log and map do not fit: seen {where}, only {share:.0%} of the beams are within "
        f"{AGREE[1]} m of what the map says; check that they are of the same place and floor, and "
        "the map's resolution and origin."
    )
