"""p(x_t | x_{t-1}, a_t): turn, then drive, each with noise.

An action is an increment (forward, left, turn): a turn, then a translation in the frame after it.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.units import PER_LENGTH
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, number
from localizers.models import motion_kernels as kernels


@final
@dataclass(frozen=True, kw_only=True)
class OdometryMotion:
    """θ' = θ + φ + ε_φ; (x', y') = (x, y) + (d + ε_d) R(θ') (u, v).

    ``ε_d ~ N(0, (drive |d|)²)``, ``ε_φ ~ N(0, (turn |φ| + drift |d|)²)`` for an increment
    (forward, left, φ) with (forward, left) = d (u, v); (u, v) = (1, 0) for a robot that drives
    straight ahead. Cf. Thrun et al. 2005, chapter 5. Two noises for three coordinates: there is no
    transition density. The defaults are what the filters of the paper preset assume.

    Attributes:
        drive: σ_dd, distance noise per distance driven.
        turn: σ_φφ, rad of heading noise per rad turned.
        drift: σ_φd, rad of heading noise per unit of length driven.
    """

    drive: float = 0.2
    turn: float = 0.3
    drift: float = field(default=0.05, metadata=PER_LENGTH)

    def __post_init__(self) -> None:
        for name in ("drive", "turn", "drift"):
            number(f"motion.{name}", getattr(self, name), low=0)

    def spread(self, action: Floats) -> tuple[float, float]:
        """Standard deviations of ε_d and ε_φ (rad) for an increment (3,)."""
        (distance, _), turn = distance_and_bearing(action), abs(float(action[-1]))
        distance = abs(distance)
        return self.drive * distance, self.turn * turn + self.drift * distance

    def sample(self, states: Singles, action: Floats, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose.

        Args:
            states: rows x, y, θ, (3, n).
            action: increment (forward, left, turn), or (d, φ).
            rng: draws n uniform numbers, whatever the action.

        Returns:
            (3, n), θ in [-π, π].
        """
        command = increments(action)
        n: int = states.shape[1]
        uniforms = rng.random(n)
        after = np.empty_like(states)
        kernels.odometry(states, uniforms, command, self.drive, self.turn, self.drift, after)
        return after

    def moves(self, actions: Floats, n: int, rng: np.random.Generator) -> Singles:
        """Draw several increments (F, 3) with their noise for n poses, step by step.

        Takes n uniform numbers a step, each of which makes two normal ones.

        Returns:
            (F, 3, n).
        """
        moves = np.empty((len(actions), 3, n), np.float32)
        uniforms = rng.random((len(actions), n))
        kernels.noisy_moves(uniforms, increments(actions), self.drive, self.turn, self.drift, moves)
        return moves


def increments(actions: ArrayLike) -> Floats:
    """Return actions (d, φ) or increments (forward, left, turn) as the latter, (..., 3).

    Raises:
        InputError: they have neither two nor three numbers.
    """
    given = np.asarray(actions, dtype=np.float64)
    columns = given.shape[-1] if given.ndim else 0
    if columns == 3:
        return given
    if columns != 2:
        raise InputError(
            f"actions have shape {given.shape}, but must be (distance, turn) or (forward, left, "
            "turn): two or three numbers a step."
        )
    found = np.zeros((*given.shape[:-1], 3))
    found[..., 0], found[..., 2] = given[..., 0], given[..., 1]
    return found


def distance_and_bearing(action: Floats) -> tuple[float, float]:
    """Return d and β of (forward, left) = d (cos β, sin β), |β| ≤ π/2: d < 0 is backwards."""
    forward, left, _ = increments(action).tolist()
    distance, u, v = kernels.along(forward, left)
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
