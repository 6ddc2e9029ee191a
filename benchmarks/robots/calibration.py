"""What beams read, and how much those of one scan tell together: fitted to part of a log.

The parts of the beam model are fitted to scans from reference poses. Beams are not independent, so
p(o | x, m)^power needs a power below 1 (Thrun, Burgard & Fox 2005, section 6.3.4): here the one
with which the filter is most exact. That its region holds is the calibration's work, not its.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.robots.played import REPLAY_SCENARIO, Replay
from benchmarks.setup.overrides import Overrides
from benchmarks.trials.collecting import TrackLog
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.tracks import calibration_of_gaussians
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError
from localizers import Calibration
from localizers.models.beams import BeamFit, fitted

PART = 0.3  # of the records, the first ones: fitted on; the rest judges
_MOST = 800  # of them for beams and power: two seconds of a filter for each power that is tried
_LEAST = 100  # records with a reference, fewer say nothing of 95 %
_PARTICLES = 1000
_NEEDED = f"{_LEAST} records with a reference in the first {PART:.0%} of the log"
_POWERS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
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
    count = fitted_part(log)
    if count is None:
        raise InputError(f"--fit-beams needs {_NEEDED}: leave it out, or set assumed.scan.….")
    first, count = int(log.referenced[0]), min(count, _MOST)
    fit = beams_of(log.of_records(np.arange(first, first + count)), floor_plan)
    parts = {name: float(f"{getattr(fit.model, name):.4g}") for name in _PARTS}
    parts["hit"] = round(1 - parts["short"] - parts["max"] - parts["rand"], 12)
    words = " ".join(f"--set assumed.scan.{name}={value:.12g}" for name, value in parts.items())
    gained = fit.log_likelihoods[0], fit.log_likelihoods[-1]
    return replace(
        replay,
        assumed=replay.assumed
        | {"scan.kind": "beam-model", **{f"scan.{name}": value for name, value in parts.items()}},
        beams=f"Beam model, by expectation maximization on {fit.readings:,} readings from "
        f"reference poses in the first {count:,} records: --set assumed.scan.kind=beam-model "
        f"{words} (sigma in {log.unit}, decay per {log.unit}; log-likelihood of a reading "
        f"{gained[0]:.3f} at the start, {gained[1]:.3f} after {len(fit.log_likelihoods) - 1} "
        "rounds).",
    )


def with_fitted_power(replay: Replay) -> Replay:
    """Return what is played with the power that is fitted to its first part, if one can be.

    That of the least log score of what ``mcl`` publishes, calibrated, of those with which it
    follows the robot: a region too narrow or too wide costs nothing there, only errors do.
    """
    count = fitted_part(replay.log)
    if count is None:
        words = (
            f"The power is 1: not fitted, which needs {_NEEDED}; a smaller --every gives more. Nor "
            "are covariances calibrated: coverage, NEES and log score are of what is believed."
        )
        return replace(replay, power=words)
    count = min(count, _MOST)
    assumed = {name: v for name, v in replay.assumed.items() if not name.startswith("prior.")}
    world = {name: v for name, v in replay.world.items() if name != "judged"}
    world["start"] = _first(replay)
    begun = replace(replay, assumed=Overrides(assumed), world=Overrides(world))
    tried = {power: _followed(begun, power, count) for power in _POWERS}
    scores = {power: score for power, (score, off) in tried.items() if off <= _NEAR}
    if not scores:
        return replace(
            replay,
            power=f"With no power of a scan's likelihood from {min(_POWERS)} to 1 does mcl "
            f"follow the robot in the first {count:,} records, so none is fitted and 1 is kept: "
            "errors and regions of methods that use it say little. Check map, mounting and start.",
        )
    power = min(scores, key=lambda tried: scores[tried])
    off = tried[power][1]
    return replace(
        replay,
        assumed=replay.assumed | {"scan.power": power},
        power=f"The likelihood of a scan is raised to the power {power:g}, the best of "
        f"{len(_POWERS)} by the log score of what mcl publishes in the first {count:,} records, "
        f"calibrated; with it, 95 % of its errors there are below {off:.2f} m.",
    )


def judged_after_part(replay: Replay) -> Replay:
    """Return what is played, its covariances judged by the records after those fitted to."""
    judged = first_judged(replay.log)
    return replay if judged is None else replace(replay, world=replay.world | {"judged": judged})


def uses_scan(name: str, params: Mapping[str, Any]) -> bool:
    """Whether a localizer weighs scans by the robot's model; ``amcl`` has one of its own."""
    return name != "amcl" or params.get("laser_model_type") == "robot"


def fitted_part(log: Log) -> int | None:
    """Return how many records from the first reference on; None if too few of them have one."""
    if log.referenced.size == 0:
        return None
    first = int(log.referenced[0])
    count = math.ceil(PART * (len(log) - first))
    known = np.count_nonzero(log.referenced < first + count)
    return count if count > 1 and known >= _LEAST else None


def first_judged(log: Log) -> int | None:
    """Return the first record after those fitted to; None if there are none."""
    count = fitted_part(log)
    return None if count is None else int(log.referenced[0]) + count


def _first(replay: Replay) -> int:
    """Return which record of the whole log is the first that is played with a reference."""
    whole, log = replay.scenario.whole, replay.log
    at = log.referenced[0]
    same = (whole.times == log.times[at]) & (whole.odometry == log.odometry[at]).all(axis=1)
    return int(np.flatnonzero(same)[0])


def _followed(replay: Replay, power: float, count: int) -> tuple[float, float]:
    """Return the log score of what is published, and the 95 % quantile of position errors, m."""
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
    off, spread = tracked.track.deviations()
    published = Calibration.fitted(off, spread).published(spread)
    score = float(calibration_of_gaussians(off, published, replay.log.unit)[:, 2].mean())
    return score, float(np.quantile(tracked.track.errors.translation, 0.95))
