"""Whole roll-outs of odometry among walls: the draws of ``OdometryMotion``, charged as they go."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.maps import RollOuts
from deqmcl_gym.numerics.types import Floats, Singles
from localizers.models.motion import OdometryMotion

_DRAWS = 2**16  # normal numbers drawn at once: more would not fit the processor's cache


@dataclass(frozen=True, kw_only=True)
class ChargedDrives:
    """Several steps of p and g in one compiled pass, with the same draws and bits as step by step.

    Attributes:
        motion: p(x_t | x_{t-1}, a_t).
        floor_plan, radius, beta: of g, as in ``FreeSpace``.
    """

    motion: OdometryMotion
    floor_plan: RollOuts
    radius: float
    beta: float

    def __call__(
        self,
        states: Singles,
        actions: Floats,
        rng: np.random.Generator,
        *,
        keep: bool,
    ) -> tuple[list[Singles], Floats]:
        """Draw one path of poses from each of ``states``; see ``Walk``."""
        n = states.shape[1]
        collisions = np.zeros(n, np.intp)
        path: list[Singles] = []
        block = max(1, _DRAWS // (2 * n))
        for first in range(0, len(actions), block):
            moves = self.motion.moves(actions[first : first + block], n, rng)
            kept = len(moves) if keep else 1
            poses, hits = self.floor_plan.rolled_out(states, moves, self.radius, kept=kept)
            collisions += hits
            states = poses[-1]
            path.extend(poses if keep else ())
        # Summed one by one, as step by step: c · β would round differently.
        charges = np.cumsum(np.append(0.0, np.full(len(actions), -self.beta)))
        return path, charges[collisions]
