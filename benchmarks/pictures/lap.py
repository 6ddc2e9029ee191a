"""One lap of one localizer: its animation, its error curve, its trace."""

import io
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.files import own_folder, write_files
from benchmarks.pictures import figures
from benchmarks.pictures.film import Film, webp
from benchmarks.pictures.messages import showing
from benchmarks.setup.interfaces import TrialEnv
from benchmarks.tables.text import csv_text, short_name, state_name
from benchmarks.trials.episode import Step
from benchmarks.trials.metrics import directions, heading_error, position_error, state_error
from benchmarks.trials.scoring import scores
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import Trace, trace_of
from deqmcl_gym.logs import Log, Trajectory, check_writable, write
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError

_ERRORS = {  # drawn, by the map's unit
    "px": (state_error, "error e (px and unitless mixed, eq. 4)"),
    "m": (position_error, "position error, m"),
}


def run_lap(trial: Trial, out: Path, log: Path | None, mcap: Path | None) -> str:
    """Run one lap of one localizer; write animation, error curve, trace; return what to print.

    ``log`` is where to write the lap as a log, ``mcap`` what is believed, for Foxglove.
    """
    figures.require_plots()
    if log is not None:
        check_writable(log)
        if os.path.lexists(log):
            raise InputError(f"{log} exists already: give another --log.")
    own_folder(out, "lap.webp")
    stage = Stage.of(trial)
    unit = stage.room.floor_plan.unit
    title = trial.localizer
    film = Film(figures.camera_of(stage), title, figures.LAP_STRIDE)
    outside: list[int] = []
    episode = _noting(outside, film.of(stage.moments()), stage.room.floor_plan)
    measure, words = _ERRORS[unit]
    heading = f"{title}, scenario {trial.scenario}, seed {trial.seed}"
    with showing(mcap, {short_name(title): episode}, stage) as rows:
        trace = trace_of((moment for (moment,) in rows), trial.offsets, stage.task)
    curves = {
        state_name(offset): (kept.states, measure(kept.means, trace.truth[kept.states]))
        for offset, kept in trace.offsets.items()
    }
    files = {
        "lap.webp": webp(film.frames, figures.LAP_MILLISECONDS),
        "error.png": figures.error_plot(curves, heading, words),
        "error.csv": _curves_csv(trace).encode(),
        "trace.npz": npz(trace),
    } | trajectories(trace)
    if log is not None:
        write(_log(film.moments, stage.room), log)
    write_files(out, files)
    lines = [_line(row, unit) for row in scores(trace, trial.lag, stage.scenario.thresholds)]
    if outside:
        lines.append(
            f"Warning: at {len(outside)} steps, the first of them {outside[0]}, more than half of "
            "the belief is inside walls or outside the map: the localizer does not use the map's "
            "walls in its motion, or is lost."
        )
    lines.append(f"Written to {out}: {', '.join(files)}.")
    lines += [] if log is None else [f"Log: {log}"]
    lines += [] if mcap is None else [f"MCAP: {mcap}"]
    return "\n".join([f"{heading}: {trace.steps} steps", *lines])


def _line(row: Mapping[str, Any], unit: str) -> str:
    """Say the errors at an offset: on a map in metres without eq. (4)'s mixture of units."""
    error, position = f"error {row['error']:6.2f}", f"position RMSE {row['position_rmse']:6.2f}"
    heading = f"heading RMSE {np.degrees(row['heading_rmse']):5.1f} deg"
    first = [error] if unit == "px" else []
    return f"{state_name(row['offset']):>8}: " + ", ".join([*first, f"{position} {unit}", heading])


def _noting(outside: list[int], episode: Iterable[Step], floor_plan: Map) -> Iterator[Step]:
    """Pass an episode on; note steps at which more than half of the weight is not free.

    That is inside walls or outside the map, where a filter that does not use it may end up.
    """
    for moment in episode:
        if (points := moment.belief.points()) is not None:
            poses, weights = points
            free = floor_plan.free(np.asarray(poses, np.float64)[:, :2])
            if np.sum(np.asarray(weights)[~free]) > 0.5:
                outside.append(moment.t)
        yield moment


def _log(episode: Sequence[Step], room: TrialEnv) -> Log:
    scans = [moment.ranges for moment in episode]
    actions = [moment.action for moment in episode[1:] if moment.action is not None]
    truth = [moment.truth for moment in episode]
    return Log.of_episode(scans, actions, truth, room.lidar, unit=room.floor_plan.unit)


def _curves_csv(trace: Trace) -> str:
    header = ["offset", "state", "true_x", "true_y", "true_heading", "x", "y", "error"]
    header += ["position_error", "heading_error"]
    rows: list[list[str]] = []
    for offset, kept in trace.offsets.items():
        truth = trace.truth[kept.states]
        errors = (of(kept.means, truth) for of in (state_error, position_error, heading_error))
        for state, true, mean, *off in zip(kept.states, truth, kept.means, *errors, strict=True):
            cells = (offset, state, *true, mean[0], mean[1], *off)
            rows.append([str(cell) for cell in cells])  # a NaN as nan, no empty cell
    return csv_text(header, rows)


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
