"""All scores, each a ``Score`` with its unit: of beliefs at an offset, whole runs, and tracks.

A trial has those of ``METRICS`` at each offset, and of ``GROUPS`` by its scenario; a whole log has
those of its track, too. Lengths of whole runs and tracks are in m; a pixel is 2 cm.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import COLUMNS, covariance_floor
from benchmarks.trials.tracks import (
    NEAR,
    RECOVERED,
    RECOVERED_STEPS,
    EstimatedTrack,
    Journey,
    agreement,
    calibration_of_gaussians,
    deviation,
    mean,
    middle,
    rms,
)
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Indices, Reals, arrays


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """What beliefs at one offset say of states s, each at t = s - offset, and the truth."""

    states: Indices  # s, (k,), ascending
    truth: Floats  # (k, 3)
    table: Floats  # a row of ``clouds.measured`` for each state
    common: Bools  # whether L ≤ s ≤ T - L, the states that every offset estimates, (k,)
    thresholds: Thresholds
    unit: str

    @property
    def means(self) -> Floats:
        """Means of (x, y, cos θ, sin θ), (k, 4)."""
        return self.table[:, :4]

    @property
    def variances(self) -> Floats:
        """Of the same; NaN for a belief of one point."""
        return self.table[:, 4:8]

    @cached_property
    def values(self) -> dict[str, Floats]:
        """The others by name, as of ``COLUMNS``."""
        return dict(zip(COLUMNS, self.table[:, 8:].T, strict=True))

    @property
    def scored(self) -> "Estimates":
        """Those of states s ≥ 1 whose truth is known."""
        chosen = (self.states >= 1) & np.isfinite(self.truth[:, 0])
        names = ("states", "truth", "table", "common")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    @cached_property
    def error(self) -> Floats:
        """Error e of each state, (k,)."""
        return state_error(self.means, self.truth)

    @cached_property
    def distance(self) -> Floats:
        """Of the estimate to the truth in (x, y), (k,)."""
        return np.asarray(np.sqrt(np.square(self.means[:, :2] - self.truth[:, :2]).sum(axis=1)))

    @cached_property
    def angle(self) -> Floats:
        """Between the direction of the mean (cos θ, sin θ) and the true heading, rad, (k,)."""
        turned = directions(self.means) - self.truth[:, 2] + math.pi
        return np.abs(turned % (2 * math.pi) - math.pi)


def state_error(means: Floats, truth: Reals) -> Floats:
    """e_t, the norm of (estimate - truth) over (x, y, cos θ, sin θ); the paper's eq. (4), (k,)."""
    x, y, heading = np.asarray(truth, dtype=np.float64).T
    true = np.column_stack([x, y, arrays.cos(heading), arrays.sin(heading)])
    return np.asarray(np.sqrt(np.square(means - true).sum(axis=1)))


def directions(means: Floats) -> Floats:
    """Headings of the mean (cos θ, sin θ), rad in (-π, π], (k,)."""
    return arrays.arctan2(means[:, 3], means[:, 2])


def entropy(variances: Floats, unit: str) -> Floats:
    """Σ_i ½ log(2πe max(v_i, f_i)) over the four components, f = (0.1 px)² and 10⁻⁶, nats, (k,).

    The entropy of a Gaussian without correlation; the paper gives no formula.
    """
    floored = np.maximum(variances, covariance_floor(unit)[[0, 1, 2, 2]])  # NaN stays NaN
    return np.asarray((0.5 * arrays.log(2 * math.pi * math.e * floored)).sum(axis=1))


LEVELS = (50, 80, 95)  # of the credible regions, per cent


@dataclass(frozen=True)
class Score:
    """A number that says how good something is."""

    name: str
    # "length" (map's unit), "length²", "m", "rad", "steps", "nats", "share" (0 or 1) or "" (number)
    unit: str
    better: str  # "low", "high", or "" if neither is
    words: str  # heading of its column; a mean over the states if it does not say otherwise
    of: Callable[[Any], float]  # ``Estimates``, ``Journey`` or ``track_scores``; NaN: unknown
    failed: float = math.nan  # the score of a run that failed; NaN: it is unknown
    tested: bool = False  # whether methods are compared by it
    digits: int | None = None  # behind the point, in tables; None: as the unit has them

    @property
    def sign(self) -> int:
        """What a value is multiplied by to be small if it is good."""
        return -1 if self.better == "high" else 1

    @property
    def censored(self) -> bool:
        """Whether infinite stands for "not within this run": metres until something happens."""
        return self.failed == math.inf


def _coverage(level: int) -> Score:
    def covered(it: Estimates) -> float:
        rank = it.values["rank"]
        return mean(np.where(np.isnan(rank), np.nan, rank <= level / 100))

    words = f"states in the {level} % credible region"
    return Score(f"coverage_{level}", "share", "", words, covered)


def _value_of(name: str) -> Callable[[Estimates], float]:
    return lambda it: mean(it.values[name])


def _lost(it: Estimates) -> float:
    last = it.distance[-it.thresholds.lost_steps :]
    return float(last.mean() > it.thresholds.lost) if last.size else math.nan


_THROUGH, _FAR = "weight that came through walls", "weight far from the truth, common states"
METRICS: tuple[Score, ...] = (
    Score("error", "", "low", "error e", lambda it: mean(it.error)),
    Score("error_window", "", "low", "e, common states", lambda it: mean(it.error[it.common])),
    Score("error_sd_steps", "", "low", "SD of e over the states", lambda it: deviation(it.error)),
    Score("entropy", "nats", "", "entropy", lambda it: mean(entropy(it.variances, it.unit))),
    Score("var_x", "length²", "", "variance of x", lambda it: mean(it.variances[:, 0])),
    Score("var_y", "length²", "", "variance of y", lambda it: mean(it.variances[:, 1])),
    Score("var_cos", "", "", "variance of cos θ", lambda it: mean(it.variances[:, 2])),
    Score("var_sin", "", "", "variance of sin θ", lambda it: mean(it.variances[:, 3])),
    Score("position_rmse", "length", "low", "position RMSE", lambda it: rms(it.distance)),
    Score("heading_rmse", "rad", "low", "heading RMSE", lambda it: rms(it.angle)),
    Score("wall_share", "share", "low", "weight in walls", _value_of("wall_share")),
    Score("energy_score", "length", "low", "energy score", _value_of("energy")),
    *map(_coverage, LEVELS),
    Score("nees", "", "", "NEES; 3 if consistent", _value_of("nees")),
    Score("lost", "share", "low", "lost at the end", _lost),
    Score("wall_step_share", "share", "low", _THROUGH, _value_of("wall_step_share")),
    Score(
        "outlier_share",
        "share",
        "low",
        _FAR,
        lambda it: mean(it.values["outlier_share"][it.common]),
    ),
)


@dataclass(frozen=True)
class ScoreGroup:
    """Scores of a whole run that belong together."""

    name: str
    scores: tuple[Score, ...]


def _share(name: str, words: str, of: Callable[[Journey], float], *, tested: bool = True) -> Score:
    """A share of runs; one that failed is none of them."""
    return Score(name, "share", "high", words, of, failed=0.0, tested=tested)


def _success(near: str, *, tested: bool) -> Score:
    place = NEAR[near]
    words = f"localized to the end ({place.distance:g} m, {math.degrees(place.angle):.0f}°)"
    return _share(f"success_{near}", words, lambda run: run.success(near), tested=tested)


def _metres(name: str, words: str, of: Callable[[Journey], float]) -> Score:
    return Score(name, "m", "low", f"{words}, median", of, failed=math.inf, tested=True)


def _committed(run: Journey) -> float:
    late = run.rated & run.last
    return float(run.false[late].any()) if late.any() else math.nan


def _to_recover(run: Journey) -> float:
    return run.metres_to_recover(run.carried)


def _late_mass(run: Journey, which: int) -> float:
    assert run.masses is not None
    return mean(run.masses[run.last, which])


def _split(run: Journey) -> float:
    """The smaller share of the mass near either place, at the end: ½ undecided, 0 picked one."""
    masses = np.array([_late_mass(run, which) for which in (0, 1)])
    return float(masses.min() / masses.sum()) if masses.sum() > 0 else math.nan


_COMMITTED = "false commitment, share of steps"
_AGAIN = f"recovered ({RECOVERED:g} m, {RECOVERED_STEPS} steps)"
_MEDIAN = Score("position_median", "m", "low", "position error, median",
    lambda run: float(np.median(run.distance)), tested=True, digits=3)  # fmt: skip
_LOST = (
    _success("1m", tested=True),
    _success("05m", tested=False),
    _metres("metres_to_localize", "metres to localize", lambda run: run.metres_to_localize),
    Score("false_commitment", "share", "low", "false commitment at the end", _committed),
    Score("false_steps", "", "low", _COMMITTED, lambda run: mean(run.false[run.rated])),
)
_AMBIGUITY = (
    Score("mass_truth", "", "", "weight near the truth", lambda run: _late_mass(run, 0)),
    Score("mass_twin", "", "", "weight near its twin", lambda run: _late_mass(run, 1)),
    Score("mass_split", "", "", "smaller share of the two", _split),
)
_RECOVERY = (
    _share("recovered", _AGAIN, lambda run: float(math.isfinite(_to_recover(run)))),
    _metres("metres_to_recover", "metres to recover", _to_recover),
)
_DRIVING = (
    _share("success", "arrived", lambda run: float(run.arrived)),
    Score("spl", "", "high", "SPL", lambda run: run.spl, failed=0.0),
    Score("contacts", "", "low", "contacts", lambda run: float(run.collided.sum())),
    Score("clearance", "m", "high", "least clearance, m", lambda run: run.clearance),
    Score("time", "steps", "low", "steps", lambda run: float(len(run.truth) - 1)),
)
GROUPS = (
    ScoreGroup("lost", _LOST),
    ScoreGroup("ambiguity", _AMBIGUITY),
    ScoreGroup("recovery", _RECOVERY),
    ScoreGroup("log", (_MEDIAN,)),
    ScoreGroup("driving", _DRIVING),
)
JOURNEY_SCORES = {score.name: score for group in GROUPS for score in group.scores}


def groups_named(names: Collection[str]) -> tuple[ScoreGroup, ...]:
    """Return groups by name, in the order of ``GROUPS``."""
    return tuple(group for group in GROUPS if group.name in names)


def journey_scores(run: Journey, groups: Sequence[ScoreGroup]) -> dict[str, float]:
    """Return the scores of a run by name."""
    return {score.name: score.of(run) for group in groups for score in group.scores}


TRACK_GROUPS = groups_named(["lost", "log"])  # those of a whole log


CALIBRATION = {"scale": "", "position": "m", "heading": "rad"}  # its numbers, and their units


def published_scores(
    track: EstimatedTrack, judged: int = 0, calibration: Any = None
) -> dict[str, float]:
    """Return the scores of covariances, at records from ``judged`` on, as a calibration has them.

    None: as believed. The log score is of a density per m² rad.
    """
    off, spread = track.deviations(judged)
    published = spread if calibration is None else calibration.published(spread)
    fits = calibration_of_gaussians(off, published, track.log.unit)
    rank, nees, log_score = fits[np.isfinite(fits).all(axis=1)].T
    per_metre = mean(log_score) - 2 * math.log(metre(track.log.unit))
    coverage = {f"coverage_{level}": mean(rank <= level / 100) for level in LEVELS}
    return coverage | {"nees": mean(nees), "log_score": per_metre}


def track_scores(
    track: EstimatedTrack,
    judged: int,
    calibration: Any,
    thresholds: Thresholds,
    floor_plan: Map | None,
) -> dict[str, float]:
    """Return the scores of a track by records, of ``TRACK_SCORES``; NaN is not available.

    ``judged`` and ``calibration`` are as of ``published_scores``; without a map no beam agrees.
    """
    errors, stamps, run = track.errors, track.at_stamps, track.journey()
    off, turned, size = errors.translation, errors.rotation, metre(track.log.unit)
    last = off[-thresholds.lost_steps :]
    within, well = math.nan, math.nan
    if floor_plan is not None:
        seen = np.flatnonzero(np.isfinite(track.best[:, 0]))
        within, well = agreement(track.log.of_records(seen), floor_plan, track.best[seen])
    lengths = {name: size if unit == "m" else 1.0 for name, unit in CALIBRATION.items()}
    return {
        **{f"within_{near}": mean(run.localized(near)) for near in NEAR},
        "position_median": middle(off),
        "position_p95": float(np.quantile(off, 0.95)) if off.size else math.nan,
        "heading_median": middle(turned),
        "position_median_stamps": middle(off[stamps]),
        "heading_median_stamps": middle(turned[stamps]),
        "lost": float(last.mean() > thresholds.lost / size) if last.size else math.nan,
        **published_scores(track, judged, calibration),
        **{
            f"calibration_{name}": float(getattr(calibration, name, math.nan)) / length
            for name, length in lengths.items()
        },
        "ape_rmse": errors.rmse,
        "rpe_rmse": track.relative.rmse,
        "agreement_01": within,
        "agreement_03": well,
    }


_STAMPS = "at the reference's own times"
_OF_TRACKS = (  # name, unit, which is better, words
    ("within_05m", "share", "high", "share of records within 0.5 m and 10°"),
    ("within_1m", "share", "high", "share of records within 1 m and 30°"),
    ("position_median", "m", "low", "median position error"),
    ("position_p95", "m", "low", "95 % position error"),
    ("heading_median", "rad", "low", "median heading error"),
    ("position_median_stamps", "m", "low", f"median position error {_STAMPS}"),
    ("heading_median_stamps", "rad", "low", f"median heading error {_STAMPS}"),
    ("lost", "share", "low", "lost at the end"),
    *((f"coverage_{k}", "share", "", f"share inside the {k} % region") for k in LEVELS),
    ("nees", "", "", "NEES; 3 if consistent"),
    ("log_score", "nats", "low", "log score of the reference pose"),
    *((f"calibration_{k}", u, "", f"{k} of the calibration") for k, u in CALIBRATION.items()),
    ("ape_rmse", "m", "low", "APE, RMSE"),
    ("rpe_rmse", "m", "low", "RPE, RMSE"),
    ("agreement_01", "share", "high", "beams within 0.1 m"),
    ("agreement_03", "share", "high", "beams within 0.3 m"),
)
TRACK_SCORES = {row[0]: Score(*row, itemgetter(row[0])) for row in _OF_TRACKS}
