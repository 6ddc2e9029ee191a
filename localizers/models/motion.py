"""p(x_t | x_{t-1}, a_t): turn, then drive, each with noise.

An action is an increment (forward, left, turn): a turn, then a translation in the frame after it.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.logs.motion import lengths_of
from deqmcl_gym.maps.drive_kernels import drive as drive_poses
from deqmcl_gym.maps.map import PER_LENGTH
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import log32, sincos32
from deqmcl_gym.validation import InputError, number

_HALF, _MINUS_TWO = np.float32(0.5), np.float32(-2.0)
_TURN, _PER_UNIFORM = np.float32(2 * np.pi), np.float32(2.0**-24)
LEAST_STEPS = 10  # to fit to
SHARE, WITHIN = 0.99, 2.5758  # so much of a normal distribution lies within so many σ
_TINY = 1e-12  # a variance: of (10⁻⁶ rad)², or as small a length


@compiled
def normal_pairs(
    uniforms: Floats,
    first_mean: float,
    first_sd: float,
    mean: float,
    sd: float,
    first: Singles,
    second: Singles,
) -> None:
    """Fill in pairs of independent normal numbers, each made of a multiple of 2⁻⁵³ in [0, 1).

    Box & Muller 1958: √(-2 log u) (cos 2πv, sin 2πv), u of the first 24 bits of the uniform number,
    v of its other 29. The largest is 5.9 standard deviations.
    """
    n = uniforms.size
    radius, angle = np.empty(n, np.float32), np.empty(n, np.float32)
    for i in range(n):
        scaled = uniforms[i] * 16777216.0
        whole = np.int32(scaled)
        radius[i] = np.float32(whole)
        angle[i] = np.float32(scaled - whole)
    for i in range(n):
        radius[i] = np.sqrt(_MINUS_TWO * log32((radius[i] + _HALF) * _PER_UNIFORM))
    for i in range(n):
        angle[i] = angle[i] * _TURN
    sincos32(angle, second, first)
    shift, scale = np.float32(first_mean), np.float32(first_sd)
    for i in range(n):
        first[i] = shift + scale * (radius[i] * first[i])
    shift, scale = np.float32(mean), np.float32(sd)
    for i in range(n):
        second[i] = shift + scale * (radius[i] * second[i])


@compiled
def along(forward: float, left: float) -> tuple[float, float, float]:
    """Return (d, u, v) with (forward, left) = d (u, v), u² + v² = 1 and u ≥ 0: d < 0 is backwards.

    (forward, 1, 0) exactly where left is 0.
    """
    if left == 0.0:
        return forward, 1.0, 0.0
    distance = np.copysign(np.sqrt(forward * forward + left * left), forward)
    return distance, forward / distance, left / distance


@compiled
def noisy_moves(
    uniforms: Floats, action: Floats, drive: float, turn: float, drift: float, out: Singles
) -> None:
    """Fill in an increment (3,) with noise, (3, n), of uniform numbers in [0, 1), (n,)."""
    angle = action[2]
    distance, u, v = along(action[0], action[1])
    sd, sd_angle = drive * abs(distance), turn * abs(angle) + drift * abs(distance)
    normal_pairs(uniforms, distance, sd, angle, sd_angle, out[0], out[2])
    if v == 0.0:
        out[1] = 0.0
        return
    ahead, aside = np.float32(u), np.float32(v)
    for i in range(uniforms.size):
        out[1, i] = out[0, i] * aside
        out[0, i] = out[0, i] * ahead


@dataclass(frozen=True, kw_only=True)
class OdometryMotion:
    """θ' = θ + φ + ε_φ; (x', y') = (x, y) + (d + ε_d) R(θ') (u, v).

    ``ε_d ~ N(0, (drive |d|)²)``, ``ε_φ ~ N(0, (turn |φ| + drift |d|)²)`` for an increment
    (forward, left, φ) with (forward, left) = d (u, v); (u, v) = (1, 0) for a robot that drives
    straight ahead. Cf. Thrun et al. 2005, chapter 5. Two noises for three coordinates: there is no
    transition density. The defaults are what the filters of the paper preset assume.
    """

    drive: float = 0.2  #: σ_dd, distance noise per distance driven
    turn: float = 0.3  #: σ_φφ, rad of heading noise per rad turned
    drift: float = field(default=0.05, metadata=PER_LENGTH)  #: σ_φd, heading, rad per length driven

    def __post_init__(self) -> None:
        for name in ("drive", "turn", "drift"):
            number(f"motion.{name}", getattr(self, name), low=0)

    def spread(self, action: Floats) -> tuple[float, float]:
        """Standard deviations of ε_d and ε_φ (rad) for an increment (3,)."""
        (distance, _), turn = distance_and_bearing(action), abs(float(action[-1]))
        distance = abs(distance)
        return self.drive * distance, self.turn * turn + self.drift * distance

    def sample(self, states: Singles, action: Floats, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose (3, n), θ in [-π, π], by n uniform numbers."""
        moves, after = np.empty((3, states.shape[1]), np.float32), np.empty_like(states)
        uniforms = rng.random((states.shape[1],))
        noisy_moves(uniforms, increments(action), self.drive, self.turn, self.drift, moves)
        drive_poses(states, moves, after)
        return after

    @classmethod
    def fitted(cls, meant: Floats, done: Floats) -> Self:
        """Return the noise of turn and drive that fits steps of a log best.

        ε_d and ε_φ are what the reference, ``done``, did beyond the odometry, ``meant``, (k, 3).
        σ_dd is such that 99 % of ``|ε_d| / |d|`` lie within 2.58 σ_dd, and never less than their
        root mean square: odometry that fails for some steps must stay possible. Only the longer
        half of the steps counts, as the reference has noise, too. σ_φφ and σ_φd maximize the
        likelihood of all ``ε_φ ~ N(0, (σ_φφ |φ| + σ_φd |d|)²)``, on an ever finer grid.

        Rows with NaN are left out; of one whose ``left`` alone is NaN the way ahead and the turn
        are known. Fewer than 10 steps with movement and a reference are refused.
        """
        steps, true, _ = moving(meant, done)
        driven, turned = lengths_of(steps), np.abs(steps[:, 2])
        off = true - steps
        off[np.isnan(off[:, 1]), 1] = 0.0
        missed = (off[:, :2] * steps[:, :2]).sum(axis=1) / np.maximum(driven, 1e-9)  # along the way
        missed_turn = arrays.wrapped(off[:, 2])
        long = longer_half(driven)
        ratio = np.abs(missed[long] / driven[long]) if long.any() else np.zeros(1)
        drive = max(np.sqrt(np.square(ratio).mean()), np.quantile(ratio, SHARE) / WITHIN)

        def cost(turn: float, drift: float) -> float:
            spread = np.maximum(turn * turned + drift * driven, 1e-6)
            return float((arrays.log(spread) + 0.5 * np.square(missed_turn / spread)).sum())

        scale = np.sqrt(np.square(missed_turn).mean())
        best = (scale / max(turned.mean(), 1e-9), scale / max(driven.mean(), 1e-9))
        width = 100.0
        for _ in range(50):  # it has converged long before
            below = arrays.exp(np.linspace(-1, 0, 4) * arrays.log(width))
            factors = np.concatenate([below, 1 / below[-2::-1]])  # from 1 / width to width
            tried = [(best[0] * a, best[1] * b) for a in factors for b in factors]
            best = min(tried, key=lambda pair: cost(*pair))
            width = max(np.sqrt(width), 1.001)
        return cls(drive=float(drive), turn=float(best[0]), drift=float(best[1]))


def increments(actions: ArrayLike) -> Floats:
    """Return actions (d, φ) or increments (forward, left, turn) as the latter, (..., 3)."""
    given = np.asarray(actions, dtype=np.float64)
    columns = given.shape[-1] if given.ndim else 0
    if columns == 3:
        return given
    if columns != 2:
        raise InputError(
            f"actions have shape {given.shape}, but must be (distance, turn) or (forward, left, "
            "turn): two or three numbers a step."
        )
    moves = np.zeros((*given.shape[:-1], 3))
    moves[..., 0], moves[..., 2] = given[..., 0], given[..., 1]
    return moves


def distance_and_bearing(action: Floats) -> tuple[float, float]:
    """Return d and β of (forward, left) = d (cos β, sin β), |β| ≤ π/2: d < 0 is backwards."""
    forward, left, _ = increments(action).tolist()
    distance, u, v = along(forward, left)
    return distance, float(arrays.arctan2(v, u)) if v != 0 else 0.0


def odometry(motion: object, method: str) -> OdometryMotion:
    """Return a motion model whose noise is known in closed form, else refuse it for a method."""
    motion = getattr(motion, "turn_and_drive", motion)
    if not isinstance(motion, OdometryMotion):
        raise InputError(
            f"the motion is {motion!r}, but the localizer {method!r} needs the spread of its "
            "noise, not only draws: give an OdometryMotion or a DifferentialMotion."
        )
    return motion


def moving(meant: Floats, done: Floats) -> tuple[Floats, Floats, Bools]:
    """Return the steps with movement and a reference, (k, 3) each, and which have a direction."""
    steps, true = np.asarray(meant, np.float64), np.asarray(done, np.float64)
    usable = np.isfinite(steps).all(axis=1) & np.isfinite(true[:, ::2]).all(axis=1)
    usable &= np.abs(steps).max(axis=1) > 0
    if usable.sum() < LEAST_STEPS:
        raise InputError(
            f"{int(usable.sum())} steps have movement and a reference at both ends, too few to fit "
            f"the noise of the motion to, which needs {LEAST_STEPS}: give the noise instead."
        )
    return steps[usable], true[usable], np.isfinite(true[usable, 1])


def longer_half(drive: Floats) -> Bools:
    """Which steps are of the longer half, (k,): noise of the reference matters less in them."""
    return drive >= max(float(np.median(drive)), 1e-9)


def most_likely(errors: Floats, features: Floats) -> tuple[float, ...]:
    """Return α ≥ 0 of greatest likelihood of errors (k,) ~ N(0, Σ α_j f_j), f (J, k).

    By multiplicative steps, none of which lowers the likelihood (Févotte & Idier 2011).
    """
    square = errors**2
    used = features.max(axis=1, initial=0.0) > 0
    alphas = np.zeros(len(features))
    alphas[used] = square.mean() / features[used].mean(axis=1) if errors.size else 0.0
    for _ in range(500):
        variance = np.maximum(_mixed(alphas, features), _TINY)
        above = (features * (square / variance**2)).sum(axis=1)
        below = np.maximum((features / variance).sum(axis=1), _TINY)
        alphas = alphas * np.sqrt(above / below)
    return tuple(float(alpha) for alpha in alphas)


def excess(alphas: tuple[float, ...], errors: Floats, features: Floats) -> float:
    """Return the factor, 1 or more, on α that brings 99 % of the errors within 2.58 σ."""
    if errors.size == 0:
        return 1.0
    spread = np.sqrt(np.maximum(_mixed(np.array(alphas), features), _TINY))
    return max(1.0, float(np.quantile(np.abs(errors) / spread, SHARE)) / WITHIN) ** 2


def _mixed(alphas: Floats, features: Floats) -> Floats:
    """Σ α_j f_j, (k,), without BLAS, whose last bits depend on the processor."""
    return np.asarray((alphas[:, None] * features).sum(axis=0))
