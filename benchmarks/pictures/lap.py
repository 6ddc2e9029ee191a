"""One lap of one localizer: its animation, its error curve, its trace."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.files import own_folder, write_part
from benchmarks.pictures.export import npz, trajectories
from benchmarks.pictures.figures import LAP_MILLISECONDS, LAP_STRIDE, camera_of
from benchmarks.pictures.film import Film
from benchmarks.pictures.frames import webp
from benchmarks.pictures.plots import error_plot, require_plots
from benchmarks.setup.trial_env import TrialEnv
from benchmarks.tables.table_1 import TITLES, state_name
from benchmarks.tables.text import csv_text
from benchmarks.trials.episode import Moment, scenario_of, task_of, trial_moments
from benchmarks.trials.metrics import state_error
from benchmarks.trials.scoring import scores
from benchmarks.trials.spec import Trial
from benchmarks.trials.trace import Trace, trace_of
from deqmcl_gym.logs import Log, check_writable, write
from deqmcl_gym.validation import InputError


def run_lap(trial: Trial, out: Path, log: Path | None = None) -> str:
    """Run one lap of one localizer; write animation, error curve, trace; return what to print.

    ``log`` is where to write the lap as a log, if anywhere.
    """
    require_plots()
    if log is not None:
        check_writable(log)
        if os.path.lexists(log):
            raise InputError(f"{log} exists already: give another --log.")
    own_folder(out, "run")
    camera = camera_of(trial, scale=1.6)
    setup = scenario_of(trial)
    unit = setup.unit
    title = TITLES.get(trial.localizer, trial.localizer)
    film = Film(camera, title, LAP_STRIDE)
    trace = trace_of(film.of(trial_moments(trial)), trial.offsets, task_of(setup.room()))
    curves = {
        state_name(offset): (kept.states, state_error(kept.means, trace.truth[kept.states]))
        for offset, kept in trace.offsets.items()
    }
    heading = f"{title}, scenario {trial.scenario}, seed {trial.seed}"
    files = {
        "lap.webp": webp(film.frames, LAP_MILLISECONDS),
        "error.png": error_plot(curves, heading, unit),
        "error.csv": _curves_csv(trace).encode(),
        "trace.npz": npz(trace),
    } | trajectories(trace)
    if log is not None:
        write(_log(film.moments, setup.room()), log)
    write_part(out, "run", files)
    lines = [
        f"{state_name(row['offset']):>8}: error {row['error']:6.2f}, position RMSE "
        f"{row['position_rmse']:6.2f} {unit}, "
        f"heading RMSE {np.degrees(row['heading_rmse']):5.1f} deg"
        for row in scores(trace, trial.lag, setup.thresholds)
    ]
    return "\n".join(
        [
            f"{heading}: {trace.steps} steps",
            *lines,
            f"Written to {out}: {', '.join(files)}.",
            *([] if log is None else [f"Log: {log}"]),
        ]
    )


def _log(episode: Sequence[Moment], room: TrialEnv) -> Log:
    scans = [moment.ranges for moment in episode]
    actions = [moment.action for moment in episode[1:] if moment.action is not None]
    truth = [moment.truth for moment in episode]
    return Log.of_episode(scans, actions, truth, room.lidar, unit=room.floor_plan.unit)


def _curves_csv(trace: Trace) -> str:
    header = ["offset", "state", "true_x", "true_y", "true_heading", "x", "y", "error"]
    return csv_text(header, _curve_lines(trace))


def _curve_lines(trace: Trace) -> Iterator[list[str]]:
    for offset, kept in trace.offsets.items():
        truth = trace.truth[kept.states]
        errors = state_error(kept.means, truth)
        for state, true, mean, error in zip(kept.states, truth, kept.means, errors, strict=True):
            cells = (offset, state, *true, mean[0], mean[1], error)
            yield [str(cell) for cell in cells]  # a NaN as nan, no empty cell
