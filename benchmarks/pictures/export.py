"""Traces for other tools: TUM trajectory files and one npz."""

import io
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from benchmarks.trials.metrics import directions
from benchmarks.trials.trace import Trace
from deqmcl_gym.numerics.types import Floats


def tum(states: Iterable[int], x: Floats, y: Floats, heading: Floats) -> str:
    """Return a trajectory in the TUM format, as evo reads it: ``t tx ty tz qx qy qz qw``.

    One step is one second; px take the place of metres; z, and rotations about x and y, are 0.

    Args:
        states: steps, (k,).
        x, y: px, (k,).
        heading: rad, (k,).
    """
    lines = [
        f"{state} {tx:.9g} {ty:.9g} 0 0 0 {math.sin(turn / 2):.12g} {math.cos(turn / 2):.12g}\n"
        for state, tx, ty, turn in zip(
            states, x.tolist(), y.tolist(), heading.tolist(), strict=True
        )
    ]
    return "".join(lines)


def trajectories(trace: Trace) -> dict[str, str]:
    """TUM files by name: the truth, and the estimates at each offset (means of the beliefs)."""
    x, y, heading = trace.truth.T
    files = {"trajectory_truth.tum": tum(range(len(trace.truth)), x, y, heading)}
    for offset, kept in trace.offsets.items():
        estimated = directions(kept.means)
        name = f"trajectory_t{offset:+d}.tum" if offset else "trajectory_t.tum"
        files[name] = tum(kept.states.tolist(), kept.means[:, 0], kept.means[:, 1], estimated)
    return files


def npz(trace: Trace) -> bytes:
    """Return the trace as npz without pickles: ``truth``, ``quality``, ``t-20/means`` ….

    For the arrays and their units see ``benchmarks.trials.trace``; read by ``numpy.load(path)``.
    """
    arrays: dict[str, NDArray[np.generic]] = {"truth": trace.truth, "quality": trace.quality}
    for offset, kept in trace.offsets.items():
        name = f"t{offset:+d}" if offset else "t"
        columns = vars(kept) | kept.values
        arrays |= {f"{name}/{key}": columns[key] for key in columns if key != "values"}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()
