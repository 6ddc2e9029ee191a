"""p(x_t | x_{t-1}, u_t): the motion models of Nav2's AMCL, and their noise fitted to a log.

An increment u = (forward, left, turn) turns by ``turn``, then moves by (forward, left) in the frame
after the turn. Seen from the pose before it, it goes ρ = |(forward, left)| in the direction
turn + atan2(left, forward). Facts from Nav2's nav2_amcl/src/motion_model.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from deqmcl_gym.maps import drive_kernels
from deqmcl_gym.maps.map import LENGTH, PER_SQUARE, PIXELS, SQUARE, pixel, scaled
from deqmcl_gym.numerics import Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32, wrapped32
from deqmcl_gym.validation import number, one_of
from localizers.models.motion import (
    OdometryMotion,
    excess,
    increments,
    longer_half,
    most_likely,
    moving,
    normal_pairs,
)


@dataclass(frozen=True, kw_only=True)
class DifferentialMotion:
    """Turn by rot1, drive ρ, turn by rot2, each with noise; Thrun et al. 2005, table 5.6.

    rot1 is the direction of the increment, rot2 = turn - rot1; rot1 = 0 if ρ < ``still``. With
    rᵢ = min(abs(rotᵢ), abs(rotᵢ - π)), which treats backward as forward, the variances are

    - of rot1: α1 r1² + α2 ρ², of rot2: α1 r2² + α2 ρ²;
    - of ρ: α3 ρ² + α4 (r1² + r2²).

    Lengths are in the map's unit. The defaults are Nav2's, for a map in metres; for one in px, take
    ``deqmcl_gym.maps.map.scaled(DifferentialMotion(), 50)``, as 1 px is 0.02 m. Source:
    differential_motion_model.cpp.
    """

    alpha1: float = 0.2  #: of a turn from turning, pure number
    alpha2: float = field(default=0.2, metadata=PER_SQUARE)  #: a turn from driving, rad² / length²
    alpha3: float = 0.2  #: of a drive from driving, pure number
    alpha4: float = field(default=0.2, metadata=SQUARE)  #: a drive from turning, length² / rad²
    still: float = field(default=0.01, metadata=LENGTH)  #: ρ below which there is no direction

    def __post_init__(self) -> None:
        _check(self)

    def sample(self, states: Singles, action: Floats, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose (3, n), by 2 n uniform numbers, whatever the action."""
        rot1, drive, rot2 = _turns_and_drive(increments(action).reshape(1, 3), self.still)
        r1, r2 = _either_way(rot1), _either_way(rot2)
        sd1 = np.sqrt(self.alpha1 * r1**2 + self.alpha2 * drive**2)
        sd_drive = np.sqrt(self.alpha3 * drive**2 + self.alpha4 * (r1**2 + r2**2))
        sd2 = np.sqrt(self.alpha1 * r2**2 + self.alpha2 * drive**2)
        return _drawn(_turned_and_driven, states, (rot1, drive, rot2), (sd1, sd_drive, sd2), rng)

    @property
    def turn_and_drive(self) -> OdometryMotion:
        """The two noises of the same variances, for estimators that need them in closed form.

        Of a straight drive ρ and the heading after it have exactly these variances, but for α4;
        across it the variance is twice that of rot1, as all noise of the heading comes before. Of a
        turn the standard deviations from turning and driving add up, which is never less.
        """
        turn, drive, drift = math.sqrt(self.alpha1), math.sqrt(self.alpha3), 2 * self.alpha2
        return OdometryMotion(drive=drive, turn=turn, drift=math.sqrt(drift))

    @classmethod
    def fitted(cls, meant: Floats, done: Floats) -> Self:
        """Return the model of greatest likelihood for steps of a log.

        Steps are as for ``OdometryMotion.fitted``. A drive that the odometry tells without its sign
        is an error of ρ, not half a turn. α3 is then raised until 99 % of the errors of ρ lie
        within 2.58 standard deviations: odometry that fails now and then must stay possible.
        ρ counts for the longer half of the steps. Of turns only the sum counts: a reference that is
        off by a cm to the side turns the direction of a short step by more than odometry ever does.
        """
        steps, true, directed = moving(meant, done)
        still = cls().still
        rot1, drive, rot2 = _turns_and_drive(steps, still)
        seen1, seen, _ = _turns_and_drive(np.where(directed[:, None], true, 0.0), still)
        seen = np.where(directed, seen, true[:, 0])
        long = longer_half(drive)
        # the nearer of two readings of one drive; a reference at rest has no direction
        backward = long & directed & (seen >= still)
        backward &= np.abs(arrays.wrapped(rot1 - seen1)) > math.pi / 2
        seen = np.where(backward, -seen, seen)
        r1, r2, d = _either_way(rot1) ** 2, _either_way(rot2) ** 2, drive**2
        error = arrays.wrapped(steps[:, 2] - true[:, 2])
        alpha1, alpha2 = most_likely(error, np.stack([r1 + r2, 2 * d]))
        features = np.stack([d, r1 + r2])[:, long]
        missed = (drive - seen)[long]
        alpha3, alpha4 = most_likely(missed, features)
        alpha3 *= excess((alpha3, alpha4), missed, features)
        return cls(alpha1=alpha1, alpha2=alpha2, alpha3=alpha3, alpha4=alpha4)


@dataclass(frozen=True, kw_only=True)
class OmniMotion:
    """Move along the increment and across it, and turn, each with noise, whatever the direction.

    The variances are α3 ρ² + α4 turn² along, α5 ρ² + α4 turn² across, α1 turn² + α2 ρ² of the turn.
    Lengths and defaults as ``DifferentialMotion``.

    Source: omni_motion_model.cpp.
    """

    alpha1: float = 0.2  #: of the turn from turning, pure number
    alpha2: float = field(default=0.2, metadata=PER_SQUARE)  #: turn from driving, rad² / length²
    alpha3: float = 0.2  #: of the way along from driving, pure number
    alpha4: float = field(default=0.2, metadata=SQUARE)  #: both ways from turning, length² / rad²
    alpha5: float = 0.2  #: of the way across from driving, pure number

    def __post_init__(self) -> None:
        _check(self)

    def sample(self, states: Singles, action: Floats, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose (3, n), by 2 n uniform numbers, whatever the action."""
        step = increments(action).reshape(1, 3)
        bearing, drive, _ = _turns_and_drive(step, 0.0)
        turn = step[:, 2]
        d, t = drive**2, turn**2
        sd_along = np.sqrt(self.alpha3 * d + self.alpha4 * t)
        sd_turn = np.sqrt(self.alpha1 * t + self.alpha2 * d)
        sd_across = np.sqrt(self.alpha4 * t + self.alpha5 * d)
        sds = sd_along, sd_turn, sd_across
        return _drawn(_moved_along, states, (bearing, drive, turn), sds, rng)

    @classmethod
    def fitted(cls, meant: Floats, done: Floats) -> Self:
        """Return the model of greatest likelihood for steps of a log.

        As ``DifferentialMotion.fitted``: α3 to α5 grow by one factor until 99 % of the errors
        along lie within 2.58 standard deviations. α5 is 0 if no step has a direction.
        """
        steps, true, directed = moving(meant, done)
        bearing, drive, _ = _turns_and_drive(steps, 0.0)
        seen_bearing, seen, _ = _turns_and_drive(np.where(directed[:, None], true, 0.0), 0.0)
        error = arrays.wrapped(steps[:, 2] - true[:, 2])
        turn, d, long = steps[:, 2] ** 2, drive**2, longer_half(drive)
        alpha1, alpha2 = most_likely(error, np.stack([turn, d]))
        off = seen_bearing - bearing
        along = np.where(directed, seen * arrays.cos(off), true[:, 0]) - drive
        across, sideways, none = seen * arrays.sin(off), long & directed, np.zeros_like(d)
        features = np.hstack(
            [np.stack([d, turn, none])[:, long], np.stack([none, turn, d])[:, sideways]]
        )
        missed = np.concatenate([along[long], across[sideways]])
        alphas = most_likely(missed, features)
        count = int(long.sum())
        factor = excess(alphas, missed[:count], features[:, :count])
        alpha3, alpha4, alpha5 = (float(alpha * factor) for alpha in alphas)
        return cls(alpha1=alpha1, alpha2=alpha2, alpha3=alpha3, alpha4=alpha4, alpha5=alpha5)


MotionModel = OdometryMotion | DifferentialMotion | OmniMotion
MOTION_MODELS: Mapping[str, type[MotionModel]] = {
    "odometry": OdometryMotion, "differential": DifferentialMotion, "omni": OmniMotion
}  # fmt: skip


def kind_of(motion: MotionModel) -> str:
    """Return the name of a motion model in ``MOTION_MODELS``."""
    return next(kind for kind, model in MOTION_MODELS.items() if isinstance(motion, model))


def unknown_motion(kind: str, unit: str) -> MotionModel:
    """Return what is assumed of a robot of which nothing is known, for a map in ``unit``.

    Nav2's defaults; for "odometry" 0.2 per m driven, 0.2 per rad turned and 0.2 rad per m.
    """
    model = MOTION_MODELS[one_of("motion model", kind, MOTION_MODELS)]
    default = model(drive=0.2, turn=0.2, drift=0.2) if model is OdometryMotion else model()
    return scaled(default, pixel(unit) / PIXELS["m"])


def composed_increment(first: Floats, then: Floats) -> Floats:
    """Return one increment (3,) for two; the turn in [-π, π]."""
    forward, left, turn = then.tolist()
    cosine, sine = float(arrays.cos([turn])[0]), float(arrays.sin([turn])[0])
    x, y, before = first.tolist()
    turned = float(arrays.wrapped([before + turn])[0])
    return np.array([forward + cosine * x + sine * y, left + cosine * y - sine * x, turned])


def moved(states: Singles, increment: Floats) -> Singles:
    """Return poses (3, n) after an increment (3,) without noise."""
    moves = np.empty((3, states.shape[1]), np.float32)
    moves[:] = increment[:, None]
    after = np.empty_like(states)
    drive_kernels.drive(states, moves, after)
    return after


def _check(motion: Any) -> None:
    for name, value in vars(motion).items():
        number(name, value, low=0)


def _turns_and_drive(steps: Floats, still: float) -> tuple[Floats, Floats, Floats]:
    """Return rot1, ρ, rot2 of increments, (k, 3), (k,) each, the turns in [-π, π]."""
    forward, left, turn = steps.T
    drive = np.sqrt(forward**2 + left**2)
    rot1 = np.where(drive < still, 0.0, arrays.wrapped(turn + arrays.arctan2(left, forward)))
    return rot1, drive, arrays.wrapped(turn - rot1)


def _either_way(turns: Floats) -> Floats:
    """Return the size of turns in [-π, π], as if driving backward were driving forward."""
    size = np.abs(turns)
    return np.minimum(size, np.pi - size)


def _drawn(
    move: Callable[..., None],
    states: Singles,
    means: tuple[Floats, ...],
    sds: tuple[Floats, ...],
    rng: np.random.Generator,
) -> Singles:
    """Return moved states, by three numbers of these means and standard deviations, (1,) each."""
    n = states.shape[1]
    # the last row is not used
    uniforms, noise, after = rng.random((2, n)), np.empty((4, n), np.float32), np.empty_like(states)
    first, second, third = (float(sd[0]) for sd in sds)
    normal_pairs(uniforms[0], 0.0, first, 0.0, second, noise[0], noise[1])
    normal_pairs(uniforms[1], 0.0, third, 0.0, 0.0, noise[2], noise[3])
    move(states, np.concatenate(means).astype(np.float32), noise, after)
    return after


@compiled
def _turned_and_driven(poses: Singles, means: Singles, noise: Singles, out: Singles) -> None:
    """Turn, drive, turn: rows rot1, ρ, rot2 of the noise (4, n) are taken off the means (3,)."""
    n = poses.shape[1]
    heading, sine, cosine = np.empty((3, n), np.float32)
    for i in range(n):
        heading[i] = wrapped32(poses[2, i] + (means[0] - noise[0, i]))
    sincos32(heading, sine, cosine)
    for i in range(n):
        drive = means[1] - noise[1, i]
        out[0, i] = poses[0, i] + drive * cosine[i]
        out[1, i] = poses[1, i] + drive * sine[i]
        out[2, i] = wrapped32(heading[i] + (means[2] - noise[2, i]))


@compiled
def _moved_along(poses: Singles, means: Singles, noise: Singles, out: Singles) -> None:
    """Move along the bearing and across it, and turn: noise rows along, turn, across, (4, n)."""
    n = poses.shape[1]
    bearing, sine, cosine = np.empty((3, n), np.float32)
    for i in range(n):
        bearing[i] = wrapped32(poses[2, i] + means[0])
    sincos32(bearing, sine, cosine)
    for i in range(n):
        along, across = means[1] + noise[0, i], noise[2, i]
        out[0, i] = poses[0, i] + (along * cosine[i] + across * sine[i])
        out[1, i] = poses[1, i] + (along * sine[i] - across * cosine[i])
        out[2, i] = wrapped32(poses[2, i] + (means[2] + noise[1, i]))
