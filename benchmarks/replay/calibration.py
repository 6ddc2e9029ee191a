"""How much the beams of one scan tell: the power of their likelihood, fitted to part of a log.

Beams are not independent: neighbours hit the same wall, and an error of the map is in all of them
and in many scans. A filter that multiplies their likelihoods is far too sure. p(o | x, m)^power
with a power below 1 is the usual remedy (Thrun, Burgard & Fox 2005, section 6.3.4); here it is the
one with which the belief's 95 % region covers the reference about as often as it says.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.replay.playing import Track, replay
from benchmarks.replay.setting import Setting, robot_of
from benchmarks.tables.text import percent
from deqmcl_gym.logs import Log
from localizers import GaussianPrior, make
from localizers.models.beams import BeamDensity

LEVEL = 0.95
PART = 0.3  # of the records, the first ones: fitted on; the rest judges
_MOST = 800  # records fitted on: two seconds of a filter for each power that is tried
_LEAST = 100  # records with a reference, fewer say nothing of 95 %
_PARTICLES = 1000
_POWERS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
_NEAR = 1.0  # m: a filter farther off follows nothing
_ROOT = 25  # of the randomness: a fit is the same for every --seed


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A power, and what it was fitted on.

    Attributes:
        power: of the likelihood of a scan.
        covered: share of the reference's poses within the 95 % region, on the part fitted on.
        untempered: the same with power 1.
        records: how many of the first were fitted on.
    """

    power: float
    covered: float
    untempered: float
    records: int

    @property
    def words(self) -> str:
        """What was done, in a sentence or two."""
        return (
            f"The likelihood of a scan is raised to the power {self.power:.3g}: with it, the 95 % "
            f"region of mcl covers {percent(self.covered)} of the reference's poses in the first "
            f"{self.records:,} records ({percent(self.untempered)} with power 1). Coverage and "
            "NEES in the tables are those of the records after them."
        )


def calibrated(setting: Setting) -> Setting:
    """Return what is played with the power that is fitted to its first part, if one can be."""
    fit = fitted_power(setting)
    if fit is None:
        return setting
    scan: BeamDensity = replace(setting.scan, power=fit.power)  # type: ignore[type-var]
    first = int(setting.log.referenced[0]) + fit.records
    return replace(setting, scan=scan, calibration=fit.words, judged=first)


def fitted_power(setting: Setting) -> Fit | None:
    """Return the power with which ``mcl`` covers the share of the reference nearest to ``LEVEL``.

    Only powers with which the filter follows the robot count. None without a reference at enough of
    the first records, or where the filter follows it with no power.

    Args:
        setting: what is played; its power is replaced.
    """
    part = _part(setting.log)
    if part is None:
        return None
    first = part.reference[0] if part.reference is not None else None
    assert first is not None
    here = replace(setting, log=part, start=tuple(first.tolist()))
    tried: list[tuple[float, float]] = []
    for power in _POWERS:
        covered, off = _covered(here, power)
        if off > _NEAR:
            break
        tried.append((covered, power))
        if covered >= LEVEL:
            break
    if not tried:
        return None
    covered, power = min(tried, key=lambda one: abs(one[0] - LEVEL))
    return Fit(power=power, covered=covered, untempered=tried[0][0], records=len(part))


def _part(log: Log) -> Log | None:
    """Return the first records, from the first one with a reference; None if too few have one."""
    if log.referenced.size == 0:
        return None
    first = int(log.referenced[0])
    count = min(_MOST, math.ceil(PART * (len(log) - first)))
    if count < 2:
        return None
    part = log.segment(first, count)
    return part if part.referenced.size >= _LEAST else None


def _covered(setting: Setting, power: float) -> tuple[float, float]:
    """Return the share covered, and the 95 % quantile of the position errors, m."""
    tempered = replace(setting, scan=replace(setting.scan, power=power))  # type: ignore[type-var]
    env = tempered.env()
    robot, prior = robot_of(tempered, env)
    assert isinstance(prior, GaussianPrior)
    rng = np.random.default_rng(np.random.SeedSequence(_ROOT, spawn_key=(0,)))
    track = replay(env, make("mcl", robot, particles=_PARTICLES), prior, rng)
    return _share(track), _off(track) / setting.metre


def _share(track: Track) -> float:
    ranks = track.ranks[np.isfinite(track.ranks)]
    return float((ranks <= LEVEL).mean()) if ranks.size else 0.0


def _off(track: Track) -> float:
    off = (track.best - track.truth)[:, :2]
    off = off[np.isfinite(off[:, 0])]
    return float(np.quantile(np.hypot(off[:, 0], off[:, 1]), 0.95))
