"""What beams read, and how much those of one scan tell together: fitted to part of a log.

The parts of the beam model are fitted to scans from reference poses. Beams are not independent, so
p(o | x, m)^power needs a power below 1 (Thrun, Burgard & Fox 2005, section 6.3.4): here the one
with which the belief's 95 % region covers the reference about as often as it says.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.robots.played import REPLAY_SCENARIO, Replay
from benchmarks.setup.overrides import Overrides
from benchmarks.tables.text import percent
from benchmarks.trials.collecting import TrackLog
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError
from localizers.models.beams import BeamFit, fitted

LEVEL = 95
PART = 0.3  # of the records, the first ones: fitted on; the rest judges
_MOST = 800  # records fitted on: two seconds of a filter for each power that is tried
_LEAST = 100  # records with a reference, fewer say nothing of 95 %
_PARTICLES = 1000
_POWERS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
_FINER = 4  # powers tried between two of them
_NEAR = 1.0  # m: a filter farther off follows nothing
_PARTS = ("hit", "short", "max", "rand", "sigma", "decay")  # of the beam model
_ROOT = 25  # of the randomness: a fit is the same for every --seed


def beams_of(log: Log, floor_plan: Map) -> BeamFit:
    """Return the beam model that fits the scans of a log best, seen from its reference poses.

    Only those at a record's own time: an interpolated pose is off, and σ would hold its error.
    """
    at = log.referenced
    if log.reference is None or at.size == 0:
        raise InputError(f"{log.source} has no reference, from which beams could be fitted.")
    if log.interpolated is not None:
        at = at[~log.interpolated[at]]
    expected = log.scanner.ranges(floor_plan, log.reference[at].T)
    ranges = log.ranges[at].astype(np.float64)
    try:
        return fitted(ranges.ravel(), expected.ravel(), log.scanner.max_range)
    except InputError as error:
        raise InputError(f"{log.source}: {error}") from None


def with_fitted_beams(replay: Replay) -> Replay:
    """Return what is played with the beam model that is fitted to its first part."""
    given = [name for name in replay.assumed if name.startswith("scan.") and name != "scan.power"]
    if given:
        raise InputError(
            f"--fit-beams is given with {', '.join(given)}, which it would fit: leave one out; of "
            "assumed.scan only power goes with it."
        )
    log, floor_plan = replay.scenario.recording()
    count = _part(log)
    if count is None:
        raise InputError(
            f"--fit-beams needs {_LEAST} records with a reference in the first {PART:.0%} of "
            f"{log.source}, at most {_MOST}: leave it out, or set assumed.scan.…."
        )
    first = int(log.referenced[0])
    fit = beams_of(log.of_records(np.arange(first, first + count)), floor_plan)
    parts = {name: float(f"{getattr(fit.model, name):.4g}") for name in _PARTS}
    parts["hit"] = round(1 - parts["short"] - parts["max"] - parts["rand"], 12)
    words = " ".join(f"--set assumed.scan.{name}={value:.12g}" for name, value in parts.items())
    gained = fit.log_likelihoods[0], fit.log_likelihoods[-1]
    return replace(
        _judged_after(replay, count),
        assumed=replay.assumed
        | {"scan.kind": "beam-model", **{f"scan.{name}": value for name, value in parts.items()}},
        beams=f"Beam model, by expectation maximization on {fit.readings:,} readings from "
        f"reference poses in the first {count:,} records: --set assumed.scan.kind=beam-model "
        f"{words} (sigma in {log.unit}, decay per {log.unit}; log-likelihood of a reading "
        f"{gained[0]:.3f} at the start, {gained[1]:.3f} after {len(fit.log_likelihoods) - 1} "
        "rounds).",
    )


def calibrated(replay: Replay) -> Replay:
    """Return what is played with the power that is fitted to its first part, if one can be.

    Of those with which ``mcl`` follows the robot, the one that covers the share of the reference
    nearest to ``LEVEL``: of a coarse grid, then between the two around it. There is none without a
    reference at enough of the first records, or where ``mcl`` follows the robot with no power.
    """
    count = _part(replay.log)
    if count is None:
        why = f"{_LEAST} records with a reference in the first {PART:.0%} of the log"
        return replace(replay, calibration=f"The power is 1: not fitted, which needs {why}.")
    assumed = {name: v for name, v in replay.assumed.items() if not name.startswith("prior.")}
    world = {name: v for name, v in replay.world.items() if name != "judged"}
    world["start"] = _first(replay)
    begun = replace(replay, assumed=Overrides(assumed), world=Overrides(world))
    tried = {power: _covered(begun, power, count) for power in _POWERS}
    level, noise = LEVEL / 100, 2 * math.sqrt(LEVEL * (100 - LEVEL)) / 100 / math.sqrt(count)
    for _ in range(_FINER):
        following = {power: share for power, (share, off) in tried.items() if off <= _NEAR}
        power = min(following, key=lambda p: abs(following[p] - level), default=math.nan)
        below = max((p for p, share in following.items() if share >= level), default=math.nan)
        above = min((p for p, share in following.items() if share < level), default=math.nan)
        between = float(f"{math.sqrt(below * above):.2g}")
        if not below < between < above or abs(following[power] - level) <= noise:
            break
        tried[between] = _covered(begun, between, count)
    if not following:
        return replace(
            replay,
            calibration=f"With no power of a scan's likelihood from {min(_POWERS)} to 1 does mcl "
            f"follow the robot in the first {count:,} records, so none is fitted and 1 is kept: "
            "errors and regions of methods that use it say little. Check map, mounting and start.",
        )
    covered = following[power]
    former = "(with power 1 it loses the robot)"
    if 1.0 in following:
        former = f"({percent(following[1.0])} with power 1)"
    doubt = f" No power comes nearer to {LEVEL} %: trust the regions as little."
    doubt = doubt if abs(covered - level) > noise else ""
    return replace(
        _judged_after(replay, count),
        assumed=replay.assumed | {"scan.power": power},
        calibration=f"The likelihood of a scan is raised to the power {power:.3g}: with it, the "
        f"95 % region of mcl covers {percent(covered)} of the reference's poses in the first "
        f"{count:,} records {former}. Coverage and NEES beside the log score are of the "
        f"records after them.{doubt}",
    )


def judged_alike(replay: Replay) -> Replay:
    """Return what is played without a fit, its beliefs judged by the records as after one."""
    count = _part(replay.log)
    return replay if count is None else _judged_after(replay, count)


def _judged_after(replay: Replay, count: int) -> Replay:
    """Return what is played, its beliefs judged by the records after those fitted on."""
    judged = int(replay.log.referenced[0]) + count
    return replace(replay, world=replay.world | {"judged": judged})


def uses_scan(name: str, params: Mapping[str, Any]) -> bool:
    """Whether a localizer weighs scans by the robot's model; ``amcl`` has one of its own."""
    return name != "amcl" or params.get("laser_model_type") == "robot"


def _part(log: Log) -> int | None:
    """Return how many records from the first reference on; None if too few of them have one."""
    if log.referenced.size == 0:
        return None
    first = int(log.referenced[0])
    count = min(_MOST, math.ceil(PART * (len(log) - first)))
    known = np.count_nonzero(log.referenced < first + count)
    return count if count > 1 and known >= _LEAST else None


def _first(replay: Replay) -> int:
    """Return which record of the whole log is the first that is played with a reference."""
    whole, log = replay.scenario.whole, replay.log
    at = log.referenced[0]
    same = (whole.times == log.times[at]) & (whole.odometry == log.odometry[at]).all(axis=1)
    return int(np.flatnonzero(same)[0])


def _covered(replay: Replay, power: float, count: int) -> tuple[float, float]:
    """Return the share covered, and the 95 % quantile of the position errors, m."""
    trial = Trial(
        scenario=REPLAY_SCENARIO,
        world=replay.world,
        assumed=replay.assumed | {"scan.power": power},
        localizer="mcl",
        params=Overrides({"particles": _PARTICLES}),
        lag=0,
        seed=_ROOT,
        trial=0,
    )
    stage = Stage.of(trial)
    tracked = stage.collector()
    assert isinstance(tracked, TrackLog)
    for step in islice(stage.moments(), count):
        tracked.see(step)
    off = float(np.quantile(tracked.track.errors.translation, 0.95))
    return tracked.scores()[f"coverage_{LEVEL}"], off
