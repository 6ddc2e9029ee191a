"""The noise of a robot's motion, estimated from its odometry against a reference."""

from dataclasses import replace

import numpy as np

from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import increments_of, lengths_of
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.validation import InputError
from localizers import OdometryMotion
from localizers.models.nav2_motion import MotionModel, unknown_motion

_SHARE, _WITHIN = 0.99, 2.5758  # so much of a normal distribution lies within so many σ
_LEAST = 10  # steps to estimate from
_ROUNDS = 50  # of the fit of two numbers, which has converged long before


def typical_steps(log: Log) -> tuple[Floats, Floats]:
    """Return increments of the odometry, and what the reference says was done, (k, 3) each.

    One for each stretch between consecutive poses of the reference: interpolated ones follow the
    odometry, so they know nothing of its noise. A stretch of n > 1 records is told as one of its
    steps, of root mean square length and turn. Its error is 1/n of what the length and the turn of
    all stretches explain (a wheel that is too small adds up by steps) and 1/√n of the rest (noise
    adds up by variances). In which direction such a step went is not known: its ``left`` is NaN.

    Raises:
        InputError: no reference, or fewer than 10 stretches with movement.
    """
    if log.reference is None:
        raise InputError(f"{log.source} has no reference: give the noise of the motion instead.")
    between = np.zeros(len(log), np.bool_) if log.interpolated is None else log.interpolated
    own = log.referenced[~between[log.referenced]]
    meant, done = increments_of(log.odometry[own]), increments_of(log.reference[own])
    steps, off = np.diff(own), done - meant
    off[:, 2] = arrays.wrapped(off[:, 2])
    length, turn = lengths_of(log.increments), log.increments[:, 2]
    way = _over(length, own)
    net = lengths_of(meant)
    ahead = (off * meant)[:, :2].sum(axis=1) / np.where(net > 0, net, 1.0)
    explained = np.column_stack(
        [
            _explained(ahead, way[:, None]),
            _explained(off[:, 2], np.column_stack([way, meant[:, 2]])),
        ]
    )
    rest = np.column_stack([ahead, off[:, 2]]) - explained
    n = steps[:, None]
    error = explained / n + rest / np.sqrt(n)
    typical = np.sqrt(np.column_stack([_over(length**2, own), _over(turn**2, own)]) / n)
    single, unknown = steps == 1, np.full(len(steps), np.nan)
    told = np.column_stack([typical[:, 0], np.zeros(len(steps)), typical[:, 1]])
    told[single] = meant[single]
    true = np.column_stack([told[:, 0] + error[:, 0], unknown, told[:, 2] + error[:, 1]])
    true[single] = done[single]
    moving = np.abs(told).max(axis=1, initial=0.0) > 0
    if moving.sum() < _LEAST:
        raise InputError(
            f"{log.source} has {int(moving.sum())} stretches with movement between poses of its "
            f"reference, too few to estimate the noise of the motion, which needs {_LEAST}: give "
            "it by --motion, or in a scenario by assumed.motion."
        )
    return told[moving], true[moving]


def _over(values: Floats, ends: Indices) -> Floats:
    """Return the sums of the values of steps, (n - 1,), between records, (k,), (k - 1,)."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(np.diff(sums[ends]))


def _explained(errors: Floats, by: Floats) -> Floats:
    """Return the least-squares fit of errors (k,) by columns (k, j) without a constant, (k,)."""
    found: Floats = by @ np.linalg.lstsq(by, errors, rcond=None)[0]
    return found


def motion_noise(log: Log, kind: str = "differential") -> MotionModel:
    """Return the motion model of a kind with the noise that a log shows, or what it assumes anyway.

    Each number is that of the fit, but at least half of ``unknown_motion``'s: where a reference was
    made with the help of the odometry, it denies its noise.

    Args:
        log: with a reference; thinned as it will be played, as the noise is that of a step.
        kind: of ``MOTION_MODELS``.

    Raises:
        InputError: fewer than 10 stretches with movement have a reference at both ends.
    """
    least, steps = unknown_motion(kind, log.unit), typical_steps(log)
    found = _odometry(*steps) if isinstance(least, OdometryMotion) else type(least).fitted(*steps)
    noise = [name for name in vars(least) if name != "still"]
    larger = {name: max(getattr(least, name) / 2, getattr(found, name)) for name in noise}
    return replace(least, **larger)


def _odometry(meant: Floats, done: Floats) -> OdometryMotion:
    """Return the noise of turn and drive that fits steps best.

    ε_d and ε_φ are what the reference did beyond the odometry at each step. σ_dd is such that 99 %
    of |ε_d| / |d| lie within 2.58 σ_dd, and never less than their root mean square: odometry that
    goes the wrong way for some steps (a speed without its sign, wheels that slip) must stay
    possible. Of the steps only the longer half counts, as the reference has noise of its own.
    σ_φφ and σ_φd maximize the likelihood of all ε_φ ~ N(0, (σ_φφ |φ| +
    σ_φd |d|)²), on a grid that is refined around its best point.
    """
    driven, turned = lengths_of(meant), np.abs(meant[:, 2])
    off = done - meant
    off[np.isnan(off[:, 1]), 1] = 0.0
    missed = (off[:, :2] * meant[:, :2]).sum(axis=1) / np.maximum(driven, 1e-9)  # along the way
    missed_turn = arrays.wrapped(off[:, 2])
    long = driven >= max(np.median(driven), 1e-9)
    ratio = np.abs(missed[long] / driven[long]) if long.any() else np.zeros(1)
    drive = max(np.sqrt(np.square(ratio).mean()), np.quantile(ratio, _SHARE) / _WITHIN)

    def cost(turn: float, drift: float) -> float:
        spread = np.maximum(turn * turned + drift * driven, 1e-6)
        return float((np.log(spread) + 0.5 * np.square(missed_turn / spread)).sum())

    scale = np.sqrt(np.square(missed_turn).mean())
    best = (scale / max(turned.mean(), 1e-9), scale / max(driven.mean(), 1e-9))
    width = 100.0
    for _ in range(_ROUNDS):
        factors = width ** np.linspace(-1, 1, 7)
        tried = [(best[0] * a, best[1] * b) for a in factors for b in factors]
        best = min(tried, key=lambda pair: cost(*pair))
        width = max(np.sqrt(width), 1.001)
    return OdometryMotion(drive=float(drive), turn=float(best[0]), drift=float(best[1]))
