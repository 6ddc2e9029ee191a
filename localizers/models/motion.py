"""p(x_t | x_{t-1}, a_t): turn, then drive, each with noise."""

from dataclasses import dataclass, field
from typing import final

import numpy as np

from deqmcl_gym.maps.units import PER_LENGTH
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, number
from localizers.models import motion_kernels as kernels


@final
@dataclass(frozen=True, kw_only=True)
class OdometryMotion:
    """θ' = θ + φ + ε_φ; (x', y') = (x, y) + (d + ε_d)(cos θ', sin θ').

    ``ε_d ~ N(0, (drive |d|)²)``, ``ε_φ ~ N(0, (turn |φ| + drift |d|)²)`` for an action a = (d, φ).
    Cf. Thrun et al. 2005, chapter 5. Two noises for three coordinates: there is no transition
    density. The defaults are what the filters of the paper preset assume.

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
        """Standard deviations of ε_d and ε_φ (rad) for an action (d, φ)."""
        distance, turn = abs(float(action[0])), abs(float(action[1]))
        return self.drive * distance, self.turn * turn + self.drift * distance

    def sample(self, states: Singles, action: Floats, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose.

        Args:
            states: rows x, y, θ, (3, n).
            action: (d, φ).
            rng: draws n uniform numbers, whatever the action.

        Returns:
            (3, n), θ in [-π, π].
        """
        command = np.asarray(action, dtype=np.float64)
        n: int = states.shape[1]
        uniforms = rng.random(n)
        after = np.empty_like(states)
        kernels.odometry(states, uniforms, command, self.drive, self.turn, self.drift, after)
        return after

    def moves(self, actions: Floats, n: int, rng: np.random.Generator) -> Singles:
        """Draw d + ε_d and φ + ε_φ of several actions (F, 2) for n poses, step by step.

        Takes n uniform numbers a step, each of which makes two normal ones.

        Returns:
            (F, 2, n).
        """
        moves = np.empty((len(actions), 2, n), np.float32)
        uniforms = rng.random((len(actions), n))
        kernels.noisy_moves(uniforms, actions, self.drive, self.turn, self.drift, moves)
        return moves


def odometry(motion: object, method: str) -> OdometryMotion:
    """Return a motion model if its noise is known in closed form, else refuse it for a method."""
    if not isinstance(motion, OdometryMotion):
        raise InputError(
            f"the motion is {motion!r}, but the localizer {method!r} needs the spread of its "
            "noise, not only draws: give an OdometryMotion."
        )
    return motion
