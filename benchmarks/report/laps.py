"""``deqmcl run``, a lap with its files; and runs as MCAP files for Foxglove and Lichtblick.

These have the topics of docs/your-map-your-log.md. They are made by foxglove-sdk, an optional
extra, from the moments that animations are drawn from. Lengths are in metres; the frames are
``map`` and ``base_link``.
"""

import math
import os
import secrets
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report.films import LAP_STRIDE, Film, best_of, camera_of, webp
from benchmarks.sweeps.store import own_folder, write_files
from benchmarks.tables import short_name, short_names, state_name
from benchmarks.trials import Trial
from benchmarks.trials.episode import Step
from benchmarks.trials.scores import directions
from benchmarks.trials.scoring import scores
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import Trace
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.files import PREFIX, SUFFIX
from deqmcl_gym.logs import Log, Trajectory, check_writable, write
from deqmcl_gym.logs.motion import dead_reckoned
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.maps.map import metre
from deqmcl_gym.maps.polygons import edges_of
from deqmcl_gym.numerics import Floats, Reals, arrays
from deqmcl_gym.validation import InputError
from localizers import quality_of
from localizers.inference.hedge import HedgedBelief

_MAP, _BASE = "map", "base_link"
_WALL, _UNKNOWN, _FREE = (31, 35, 40, 255), (176, 184, 192, 255), (255, 255, 255, 255)
_GREEN, _BLACK = (0.0, 0.62, 0.45), (0.12, 0.14, 0.16)
_NUMBERS = ("step", "quality", "trusted", "position_error_m", "heading_error_deg")
_SERIES: dict[str, Any] = {"type": "object", "title": "deqmcl.Series"}
_SERIES["properties"] = {name: {"type": "number"} for name in _NUMBERS}


class Messages:
    """Logs what localizers believe after each step; the map with the first.

    ``context`` is one of foxglove with a file, ``stage`` that of any of their runs.
    """

    def __init__(self, context: Any, stage: Stage, names: Sequence[str]) -> None:
        from foxglove import messages

        self._context, self._fox, self._stage, self._names = context, messages, stage, names
        self._metre = metre(stage.room.floor_plan.unit)
        self._channels: dict[str, Any] = {}

    def passed(self, moments: tuple[Step, ...]) -> tuple[Step, ...]:
        """Log what the localizers believe after a step that was just run, and return it."""
        first, unit = moments[0], self._stage.room.floor_plan.unit
        self._time = round(_time(self._stage, first) * 1e9)
        self._stamp = self._fox.Timestamp(*divmod(self._time, 10**9))
        if "/map" not in self._channels:
            self._log("/map", self._map(self._stage.room.floor_plan))
        truth = first.truth if np.isfinite(first.truth).all() else None
        best = [best_of(moment, unit) for moment in moments]
        position, orientation = self._placed(best[0] if truth is None else truth)
        moved = self._fox.FrameTransform(
            timestamp=self._stamp,
            parent_frame_id=_MAP,
            child_frame_id=_BASE,
            translation=position,
            rotation=orientation,
        )
        self._log("/tf", moved)
        if truth is not None:
            self._log("/truth", self._framed("PoseInFrame", pose=self._pose(truth)))
        self._log("/scan", self._scan(first.ranges))
        for name, moment, at in zip(self._names, moments, best, strict=True):
            self._write_belief(name, moment, at, truth)
        return moments

    def _write_belief(self, name: str, moment: Step, best: Reals, truth: Reals | None) -> None:
        belief, lag = moment.belief, self._stage.trial.lag
        series: dict[str, float | None] = {"step": moment.t, "quality": quality_of(belief)}
        clouds = {"cloud": belief.points()}
        if lag:
            clouds |= {"past": belief.points(-lag), "future": belief.points(lag)}
        if isinstance(belief, HedgedBelief):
            clouds |= {"advised": belief.advised.points(), "protected": belief.protected.points()}
            series["trusted"] = belief.trusted
        if truth is not None:
            off = (best - truth) / np.array([self._metre, self._metre, 1.0])
            series["position_error_m"] = math.hypot(off[0], off[1])
            series["heading_error_deg"] = math.degrees(abs(float(arrays.wrapped(off[2:])[0])))
        self._log(f"/{name}/estimate", self._framed("PoseInFrame", pose=self._pose(best)))
        for kind, points in clouds.items():
            if points is not None:
                self._log(f"/{name}/{kind}", self._cloud(np.asarray(points[0]), points[1]))
        if moment.plan is not None:
            start = best if truth is None else truth
            way = dead_reckoned(moment.plan, start)[:, :2]
            self._log(f"/{name}/plan", self._lines("plan", way, "LineStrip", _GREEN))
        self._log(f"/{name}/series", {k: value for k, value in series.items() if value is not None})

    def _log(self, topic: str, message: Any) -> None:
        if topic not in self._channels:
            from foxglove import Channel, channels

            kind: Any = getattr(channels, f"{type(message).__name__}Channel", Channel)
            schema = {"schema": _SERIES} if isinstance(message, dict) else {}
            self._channels[topic] = kind(topic, context=self._context, **schema)
        self._channels[topic].log(message, log_time=self._time)

    def _framed(self, kind: str, frame: str = _MAP, **parts: Any) -> Any:
        """A message of a kind with the time and a frame."""
        return getattr(self._fox, kind)(timestamp=self._stamp, frame_id=frame, **parts)

    def _placed(self, pose: Sequence[float] | Reals) -> tuple[Any, Any]:
        """Position in metres, and orientation."""
        x, y, heading = np.asarray(pose, np.float64).tolist()
        return (
            self._fox.Vector3(x=x / self._metre, y=y / self._metre, z=0.0),
            self._fox.Quaternion(z=math.sin(heading / 2), w=math.cos(heading / 2)),
        )

    def _pose(self, pose: Sequence[float] | Reals = (0.0, 0.0, 0.0)) -> Any:
        position, orientation = self._placed(pose)
        return self._fox.Pose(position=position, orientation=orientation)

    def _scan(self, ranges: Reals) -> Any:
        """The ends of the beams that return: lidars may be several, and their angles uneven."""
        lidar, seen = self._stage.room.lidar, np.asarray(ranges, np.float64)
        hit = seen <= lidar.max_range  # false for NaN
        x, y, bearings = lidar.rays(np.zeros(3))[hit].T
        ends = [x + seen[hit] * np.cos(bearings), y + seen[hit] * np.sin(bearings), bearings]
        return self._cloud(np.column_stack(ends), np.ones(int(hit.sum())), _BASE)

    def _cloud(self, poses: Reals, weights: Reals, frame: str = _MAP) -> Any:
        height = np.zeros(len(poses))
        table = np.column_stack([poses[:, :2] / self._metre, height, poses[:, 2], weights])
        return self._framed(
            "PointCloud",
            frame,
            pose=self._pose(),
            point_stride=4 * table.shape[1],
            fields=self._fields(("x", "y", "z", "heading", "weight"), 4, "Float32"),
            data=table.astype("<f4").tobytes(),
        )

    def _fields(self, names: Sequence[str], size: int, kind: str) -> list[Any]:
        """What packed numbers of so many bytes are called."""
        number = getattr(self._fox.PackedElementFieldNumericType, kind)
        return [
            self._fox.PackedElementField(name=name, offset=size * place, type=number)
            for place, name in enumerate(names)
        ]

    def _lines(self, name: str, way: Floats, kind: str, ink: tuple[float, float, float]) -> Any:
        """A line through points (n, 2), or one between each two of them; none of a single point."""
        red, green, blue = ink
        line = self._fox.LinePrimitive(
            type=getattr(self._fox.LinePrimitiveLineType, kind),
            pose=self._pose(),
            thickness=2.0,
            scale_invariant=True,
            points=[self._fox.Point3(x=x, y=y, z=0.0) for x, y in (way / self._metre).tolist()],
            color=self._fox.Color(r=red, g=green, b=blue, a=1.0),
        )
        entity = self._framed("SceneEntity", id=name, lines=[line] if len(way) > 1 else [])
        return self._fox.SceneUpdate(entities=[entity])

    def _map(self, floor_plan: Any) -> Any:
        if isinstance(floor_plan, PolygonMap):
            walls = [np.array(corners) for corners in (floor_plan.outer, *floor_plan.obstacles)]
            ends = np.vstack([edges_of(corners) for corners in walls]).reshape(-1, 2)
            return self._lines("walls", ends, "LineList", _BLACK)
        cells = floor_plan.occupancy
        colors = np.full((*cells.shape, 4), _FREE, np.uint8)
        colors[floor_plan.solid] = _WALL
        colors[cells < 0] = _UNKNOWN
        size = floor_plan.resolution / self._metre
        return self._framed(
            "Grid",
            pose=self._pose(floor_plan.origin),
            column_count=cells.shape[1],
            cell_size=self._fox.Vector2(x=size, y=size),
            row_stride=4 * cells.shape[1],
            cell_stride=4,
            fields=self._fields(("red", "green", "blue", "alpha"), 1, "Uint8"),
            data=colors.tobytes(),
        )


def mcap_file(path: Path | None) -> Path | None:
    """Return the absolute path of a file for Foxglove; refuse other endings, or one that exists."""
    if path is None:
        return None
    if find_spec("foxglove") is None:
        raise InputError(
            "--mcap needs foxglove-sdk, which is not installed: pip install 'deqmcl-gym[view]'."
        )
    if path.suffix.lower() != ".mcap":
        raise InputError(f"--mcap is {path}, but must end in .mcap.")
    if os.path.lexists(path):
        raise InputError(f"{path} exists already: give another --mcap.")
    return path.absolute()


@contextmanager
def showing(
    path: Path | None, runs: Mapping[str, Iterable[Step]], stage: Stage
) -> Iterator[Iterable[tuple[Step, ...]]]:
    """Yield runs of one world by localizer, side by side; write them to a file as they go on.

    The file is there, whole, if the runs have ended; times before 0 s are refused.
    """
    rows = zip(*runs.values(), strict=True)
    if path is None:
        yield rows
        return
    from foxglove import Context, open_mcap

    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{PREFIX}{secrets.token_hex(4)}{SUFFIX}")
    try:
        with open_mcap(beside, context=(context := Context())):
            messages = Messages(context, stage, tuple(runs))
            yield map(messages.passed, rows)
        if next(rows, None) is None:
            beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def shown_again(trials: Sequence[Trial], path: Path) -> None:
    """Run trials on one log or in one world again, side by side, and write them to a file."""
    stages = [Stage.of(trial) for trial in trials]
    short = short_names([trial.localizer for trial in trials])
    runs = {short[stage.trial.localizer]: stage.moments() for stage in stages}
    with showing(path, runs, stages[0]) as rows:
        deque(rows, maxlen=0)


def _time(stage: Stage, moment: Step) -> float:
    """Return the time of a moment that was just run, s: its record's; in a room 1 s a step."""
    if not isinstance(stage.room, LogEnv):
        return float(moment.t)
    at = stage.room.record.time
    if at < 0:
        raise InputError(
            f"a record of the log is at {at:g} s, but Foxglove has no time before 0 s: give a log "
            "with later times."
        )
    return at


def run_lap(trial: Trial, out: Path, log: Path | None, mcap: Path | None) -> str:
    """Run a lap; write animation, errors, poses, if asked a log, an MCAP; return what to print."""
    if log is not None:
        check_writable(log)
        if os.path.lexists(log):
            raise InputError(f"{log} exists already: give another --log.")
    own_folder(out, "lap.webp")
    stage = Stage.of(trial)
    unit = stage.room.floor_plan.unit
    film = Film(camera_of(stage), trial.localizer, LAP_STRIDE)
    with showing(mcap, {short_name(trial.localizer): film.of(stage.moments())}, stage) as rows:
        trace = Trace((moment for (moment,) in rows), trial.offsets, stage.task)
    files = {"lap.webp": webp(film.frames), "error.csv": _curves_csv(trace).encode()}
    files |= trajectories(trace)
    if log is not None:
        scans, truth = zip(*((moment.ranges, moment.truth) for moment in film.moments), strict=True)
        actions = [moment.action for moment in film.moments[1:] if moment.action is not None]
        write(Log.of_episode(scans, actions, truth, stage.room.lidar, unit=unit), log)
    write_files(out, files)
    heading = f"{trial.localizer}, scenario {trial.scenario}, seed {trial.seed}"
    lines = [f"{heading}: {trace.steps} steps", *(_line(row, unit) for row in scores(trace))]
    lines.append(f"Written to {out}: {', '.join(files)}.")
    lines += [f"{kind}: {path}" for kind, path in (("Log", log), ("MCAP", mcap)) if path]
    return "\n".join(lines)


def _line(row: Mapping[str, Any], unit: str) -> str:
    """Say the errors at an offset: on a map in metres without eq. (4)'s mixture of units."""
    error, position = f"error {row['error']:6.2f}", f"position RMSE {row['position_rmse']:6.2f}"
    heading = f"heading RMSE {np.degrees(row['heading_rmse']):5.1f} deg"
    first = [error] if unit == "px" else []
    return f"{state_name(row['offset']):>8}: " + ", ".join([*first, f"{position} {unit}", heading])


def _curves_csv(trace: Trace) -> str:
    rows = ["offset,state,true_x,true_y,true_heading,x,y,error,position_error,heading_error"]
    for offset, estimates in trace.offsets.items():
        errors = estimates.error, estimates.distance, estimates.angle
        columns = estimates.states, estimates.truth, estimates.means, *errors
        for state, true, mean, *off in zip(*columns, strict=True):
            rows.append(",".join(map(str, (offset, state, *true, mean[0], mean[1], *off))))
    return "\n".join(rows) + "\n"


def trajectories(trace: Trace) -> dict[str, bytes]:
    """TUM files by name: truth, and means of beliefs at each offset; a step is 1 s, px stay px."""
    steps = np.arange(float(len(trace.truth)))
    files = {"trajectory_truth.tum": Trajectory(steps, trace.truth).tum}
    for offset, estimates in trace.offsets.items():
        poses = np.column_stack([estimates.means[:, :2], directions(estimates.means)])
        name = f"trajectory_t{offset:+d}.tum" if offset else "trajectory_t.tum"
        files[name] = Trajectory(estimates.states.astype(np.float64), poses).tum
    return files
