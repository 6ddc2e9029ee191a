"""The paper's figures, always of world 0: no picking; and ``deqmcl run``, a lap with its files."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.files import own_folder, write_files
from benchmarks.report.films import Camera, Film, camera_of, png, side_by_side, webp
from benchmarks.report.messages import showing
from benchmarks.setup import TrialEnv
from benchmarks.tables.text import short_name, state_name
from benchmarks.trials.episode import Step
from benchmarks.trials.scores import directions, heading_error, position_error, state_error
from benchmarks.trials.scoring import scores
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import Trace, trace_of
from deqmcl_gym.logs import Log, Trajectory, check_writable, write
from deqmcl_gym.validation import InputError

FIG_4_METHODS = ("deq-mcl", "mcl")
FIG_5_METHOD = "deq-mcl"
FIG_5_STATE = 150  # the paper's
LAP_METHODS = ("mcl", "deq-mcl")
_SHOWN = {*FIG_4_METHODS, FIG_5_METHOD, *LAP_METHODS}
LAP_STRIDE = 4  # steps per frame
LAP_MILLISECONDS = 120


def write_paper_figures(shown: Sequence[Trial], folder: Path) -> list[Path]:
    """Draw the figures of the trials that are ``chosen``."""
    return write_files(folder, figures_of(shown))


def chosen(trials: Sequence[Trial]) -> list[Trial]:
    """Return trial 0 of each method that is shown."""
    return [t for t in trials if (t.trial, t.filter_seed) == (0, 0) and t.localizer in _SHOWN]


def figures_of(trials: Sequence[Trial]) -> dict[str, bytes]:
    """Draw what can be drawn of these methods, each given by its trial 0, by file name."""
    stages = [Stage.of(trial) for trial in trials]
    seen = {s.trial.localizer: (camera_of(s), list(s.moments())) for s in stages}
    contents: dict[str, bytes] = {}
    for method in FIG_4_METHODS:
        if method in seen:
            camera, episode = seen[method]
            half_way = episode[(len(episode) - 1) // 2]
            contents[f"fig4_{method}.png"] = png(camera.frame(half_way, [method]))
    if FIG_5_METHOD in seen:
        contents |= _fig_5(*seen[FIG_5_METHOD])
    shown = [method for method in LAP_METHODS if method in seen]
    if shown:
        small = camera_of(stages[0], scale=1.2)
        laps = [
            [small.frame(moment, [method]) for moment in seen[method][1][::LAP_STRIDE]]
            for method in shown
        ]
        frames = [side_by_side(row) for row in zip(*laps, strict=True)]
        contents["lap.webp"] = webp(frames, LAP_MILLISECONDS)
    return contents


def _fig_5(camera: Camera, episode: Sequence[Step]) -> dict[str, bytes]:
    """State 150 seen at step 150, and looked back at L steps later."""
    later = FIG_5_STATE + camera.lag
    if later >= len(episode):
        return {}
    images = {}
    truth = episode[FIG_5_STATE].truth
    for step, offset in ((FIG_5_STATE, 0), (later, -camera.lag)):  # the same if L = 0
        words = [f"{FIG_5_METHOD}, state {FIG_5_STATE} seen at step {step}"]
        ring = ("true pose then", truth.tolist()) if offset else None
        frame = camera.frame(episode[step], words, ring, offset=offset)
        images[f"fig5_step{step}.png"] = png(frame)
    return images


def run_lap(trial: Trial, out: Path, log: Path | None, mcap: Path | None) -> str:
    """Run one lap of one localizer; write animation, errors, poses; return what to print.

    ``log`` is where to write the lap as a log, ``mcap`` what is believed, for Foxglove.
    """
    if log is not None:
        check_writable(log)
        if os.path.lexists(log):
            raise InputError(f"{log} exists already: give another --log.")
    own_folder(out, "lap.webp")
    stage = Stage.of(trial)
    unit = stage.room.floor_plan.unit
    title = trial.localizer
    film = Film(camera_of(stage), title, LAP_STRIDE)
    heading = f"{title}, scenario {trial.scenario}, seed {trial.seed}"
    with showing(mcap, {short_name(title): film.of(stage.moments())}, stage) as rows:
        trace = trace_of((moment for (moment,) in rows), trial.offsets, stage.task)
    files = {
        "lap.webp": webp(film.frames, LAP_MILLISECONDS),
        "error.csv": _curves_csv(trace).encode(),
    } | trajectories(trace)
    if log is not None:
        write(_log(film.moments, stage.room), log)
    write_files(out, files)
    lines = [_line(row, unit) for row in scores(trace)]
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


def _log(episode: Sequence[Step], room: TrialEnv) -> Log:
    scans = [moment.ranges for moment in episode]
    actions = [moment.action for moment in episode[1:] if moment.action is not None]
    truth = [moment.truth for moment in episode]
    return Log.of_episode(scans, actions, truth, room.lidar, unit=room.floor_plan.unit)


def _curves_csv(trace: Trace) -> str:
    header = "offset,state,true_x,true_y,true_heading,x,y,error,position_error,heading_error"
    rows = [header]
    for offset, kept in trace.offsets.items():
        truth = trace.truth[kept.states]
        errors = (of(kept.means, truth) for of in (state_error, position_error, heading_error))
        for state, true, mean, *off in zip(kept.states, truth, kept.means, *errors, strict=True):
            rows.append(",".join(map(str, (offset, state, *true, mean[0], mean[1], *off))))
    return "\n".join(rows) + "\n"


def trajectories(trace: Trace) -> dict[str, bytes]:
    """TUM files by name: truth, and means of beliefs at each offset; a step is 1 s, px stay px."""
    steps = np.arange(float(len(trace.truth)))
    files = {"trajectory_truth.tum": Trajectory(steps, trace.truth).tum}
    for offset, kept in trace.offsets.items():
        poses = np.column_stack([kept.means[:, :2], directions(kept.means)])
        name = f"trajectory_t{offset:+d}.tum" if offset else "trajectory_t.tum"
        files[name] = Trajectory(kept.states.astype(np.float64), poses).tum
    return files
