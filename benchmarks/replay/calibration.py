"""How much the beams of one scan tell: the power of their likelihood, fitted to part of a log.

Beams are not independent: neighbours hit the same wall, and an error of the map is in all of them
and in many scans. A filter that multiplies their likelihoods is far too sure. p(o | x, m)^power
with a power below 1 is the usual remedy (Thrun, Burgard & Fox 2005, section 6.3.4); here it is the
one with which the belief's 95 % region covers the reference about as often as it says.
"""

import math
from dataclasses import replace
from itertools import islice

import numpy as np

from benchmarks.replay.options import NAME, Replay
from benchmarks.setup.changes import Changes
from benchmarks.tables.text import percent
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.tracks import TrackLog
from deqmcl_gym.logs import Log

LEVEL = 95
PART = 0.3  # of the records, the first ones: fitted on; the rest judges
_MOST = 800  # records fitted on: two seconds of a filter for each power that is tried
_LEAST = 100  # records with a reference, fewer say nothing of 95 %
_PARTICLES = 1000
_POWERS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
_NEAR = 1.0  # m: a filter farther off follows nothing
_ROOT = 25  # of the randomness: a fit is the same for every --seed


def calibrated(replay: Replay) -> Replay:
    """Return what is played with the power that is fitted to its first part, if one can be.

    It is the power with which ``mcl`` covers the share of the reference nearest to ``LEVEL``, of
    those with which it follows the robot. None can be fitted without a reference at enough of the
    first records, or where the filter follows it with no power.
    """
    count = _part(replay.log)
    if count is None:
        return replay
    here = {name: own for name, own in replay.assumed.items() if not name.startswith("prior.")}
    world = replay.world | {"start": _first(replay)}
    begun = replace(replay, assumed=Changes(here), world=world)
    tried: list[tuple[float, float]] = []
    for power in _POWERS:
        covered, off = _covered(begun, power, count)
        if off > _NEAR:
            break
        tried.append((covered, power))
        if covered >= LEVEL / 100:
            break
    if not tried:
        return replay
    covered, power = min(tried, key=lambda one: abs(one[0] - LEVEL / 100))
    return replace(
        replay,
        world=replay.world | {"judged": int(replay.log.referenced[0]) + count},
        assumed=replay.assumed | {"scan.power": power},
        calibration=f"The likelihood of a scan is raised to the power {power:.3g}: with it, the "
        f"95 % region of mcl covers {percent(covered)} of the reference's poses in the first "
        f"{count:,} records ({percent(tried[0][0])} with power 1). Coverage and NEES in the tables "
        "are those of the records after them.",
    )


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
        scenario=NAME,
        world=replay.world,
        assumed=replay.assumed | {"scan.power": power},
        localizer="mcl",
        params=Changes({"particles": _PARTICLES}),
        lag=0,
        seed=_ROOT,
        trial=0,
    )
    stage = Stage.of(trial)
    kept = stage.collector()
    assert isinstance(kept, TrackLog)
    for moment in islice(stage.moments(), count):
        kept.see(moment)
    off = float(np.quantile(kept.track.errors.translation, 0.95))
    return kept.scores()[f"coverage_{LEVEL}"], off
