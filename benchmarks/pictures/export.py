"""Traces for other tools: TUM trajectory files and one npz."""

import io

import numpy as np
from numpy.typing import NDArray

from benchmarks.trials.metrics import directions
from benchmarks.trials.trace import Trace
from deqmcl_gym.logs import Trajectory


def trajectories(trace: Trace) -> dict[str, bytes]:
    """TUM files by name: the truth, and the estimates at each offset (means of the beliefs).

    One step is one second; px take the place of metres in a room in px.
    """
    steps = np.arange(float(len(trace.truth)))
    files = {"trajectory_truth.tum": Trajectory(steps, trace.truth).tum}
    for offset, kept in trace.offsets.items():
        poses = np.column_stack([kept.means[:, :2], directions(kept.means)])
        name = f"trajectory_t{offset:+d}.tum" if offset else "trajectory_t.tum"
        files[name] = Trajectory(kept.states.astype(np.float64), poses).tum
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
