"""LogEnv: a recorded log as a Gymnasium environment, ``deqmcl_gym/Log-v0``, and its arguments."""

import math
import re
from collections.abc import Mapping, Sequence
from inspect import signature
from os import PathLike
from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym import logs, validation
from deqmcl_gym.maps import Map, PolygonMap
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Indices, Pose, Singles
from deqmcl_gym.validation import InputError, NoEpisodeError, integer, number, one_of, shown
from deqmcl_gym.world import WORLDS
from deqmcl_gym.world.differences import map_changed
from deqmcl_gym.world.rules import StepResult, check_options


def log_of(given: Any, reference: Any, reading: Mapping[str, Any] | None) -> logs.Log:
    """Return a log given as a ``Log`` or by its path, with its reference."""
    if not isinstance(given, logs.Log):
        if not isinstance(given, str | PathLike | list | tuple):
            raise InputError(f"log is {given!r}, but must be the path of a log, or a Log.")
        if not isinstance(reading, Mapping | None):
            raise InputError(f"reading is {shown(reading)}, but must be arguments of logs.read.")
        options = dict(reading or {})
        allowed = set(signature(logs.read).parameters) - {"path", "reference"}
        for name in options:
            one_of("key in reading", name, allowed)
        return logs.read(given, reference=reference, **options)
    if reading:
        raise InputError("reading is given, but the log has been read already: leave it out.")
    return given if reference is None else logs.referenced(given, reference)


def map_of(given: Any, unknown: Any, log: logs.Log) -> Map | None:
    """Return a map given as a ``Map``, by its path or by its corners; None is none."""
    path = str(given) if isinstance(given, str | PathLike) else ""
    if path.endswith((".pgm", ".png", ".bmp")):
        raise InputError(
            f"the map is {shown(given)}, an image, but must be the .yaml file that names the image "
            "and tells its resolution: give the path of that."
        )
    if unknown is not None:
        if not path.endswith((".yaml", ".yml")):
            raise InputError(
                f"the map is {shown(given)}, but must be a .yaml file where unknown is given "
                f"({shown(unknown)}), as only that has unknown cells: give its path, or leave "
                "unknown out."
            )
        given = {"file": given, "unknown": unknown}
    if given is None:
        return None
    ours = isinstance(given, Map)
    floor_plan: Map = given if ours else WORLDS["paper"].changed(floor_plan=given).floor_plan
    if floor_plan.unit != log.unit:
        raise InputError(
            f"the map is in {floor_plan.unit}, but {log.source} in {log.unit}: give a map in "
            f"{log.unit}."
        )
    return floor_plan


def log_segments(log: logs.Log, length: float | None) -> Indices:
    """Return the first and the last record of each segment that an episode may play, (k, 2).

    Its length is by odometry; None is the whole log. Where the log has a reference, each record of
    a segment must have one.
    """
    if length is None:
        return np.array([[0, len(log) - 1]])
    number("segment", length, low=0, above=True)
    way = log.driven
    # a record further, where the length is below the rounding of the way
    last = np.maximum(np.searchsorted(way, way + length), np.arange(1, len(log) + 1))
    whole = last < len(log)
    if log.reference is not None:
        counts = np.searchsorted(log.referenced, np.arange(len(log) + 1))  # among the first k
        first = np.flatnonzero(whole)
        whole[first] = counts[last[first] + 1] - counts[first] == last[first] + 1 - first
    if not whole.any():
        where = "" if log.reference is None else " with a reference at each record"
        raise InputError(
            f"segment is {length:g} {log.unit}, but {log.source}, of {way[-1]:.4g} {log.unit}, has "
            f"no stretch as long as that{where}: give a smaller segment."
        )
    return np.column_stack([np.flatnonzero(whole), last[whole]])


def spacing(what: str, given: object, unit: str) -> tuple[float, float]:
    """Return a distance and an angle (rad) of "0.2m,5deg", "0.2m", "5deg", "0.1rad" or a pair."""
    if not isinstance(given, str):
        distance, angle = validation.array(what, cast(ArrayLike, given), (2,)).tolist()
        return distance, angle
    thresholds = {"length": math.inf, "angle": math.inf}
    for part in given.split(","):
        match = re.fullmatch(r"\s*((?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(m|px|deg|°|rad)\s*", part)
        kind = "length" if match and match[2] in ("m", "px") else "angle"
        if match is None or math.isfinite(thresholds[kind]):
            raise InputError(
                f'{what} is {given!r}, but must be a distance and an angle, such as "0.2m,5deg".'
            )
        if kind == "length" and match[2] != unit:
            raise InputError(f"{what} is {given!r}, but the log is in {unit}: give {unit}.")
        value = float(match[1])
        thresholds[kind] = math.radians(value) if match[2] in ("deg", "°") else value
    return thresholds["length"], thresholds["angle"]


_SAME = 1e-5  # of an action: single precision, and text of 6 digits
_RADIUS = 8.0  # px, of the robot
_SIDE = 960  # image pixels of a picture without a map


class LogEnv(gym.Env[Singles, Singles]):
    """A recorded log, played back record by record: scans, odometry and, if known, true poses.

    ```python
    import gymnasium as gym, deqmcl_gym

    env = gym.make("deqmcl_gym/Log-v0", log="robot.log.gz", map="map.yaml", reference="robot.tum")
    ranges, info = env.reset()
    terminated = False
    while not terminated:
        action = info["planned_actions"][0]
        ranges, reward, terminated, truncated, info = env.step(action)
    ```

    **Action Space**: `Box(-a, a, (3,), float32)`: an increment of the odometry, (forward, left,
    turn): a turn (rad), then a translation (in the log's unit) in the frame after it, so that an
    action (d, φ) of `Room-v0` is (d, 0, φ). a are the largest recorded increments. The robot
    cannot be steered: the action given must be the recorded one (`env.unwrapped.next_action`, the
    first of `info["planned_actions"]` if the plan is the odometry's). `on_mismatch` says what
    happens otherwise; another action is never carried out. Checkers that try random actions, such
    as Gymnasium's `check_env`, need `on_mismatch="ignore"`.

    **Observation Space**: `Box(0, 3 r, (beams,), float32)` for a scanner's `max_range` r: the scan.
    Where nothing is within reach it reads 2 r, where a beam failed or saw something too near 3 r,
    as Gymnasium's checker requires finite spaces; localizers skip ranges above r.

    **Info**: the keys of `Room-v0`. `command` is the odometry's increment that led here, (3,).
    `planned_actions` (horizon, 3) are the increments to come,
    as if the log were a plan that was carried out, and `planned_count` is their number; `collided`
    is always 0; `is_success` is 1 at the last record. `truth` is the reference pose, inf at
    records without one; a log without a reference has none. The env reveals it in no other way.

    **Poses** are the robot's (ROS: `base_link`). `env.unwrapped.lidar` knows where on the robot it
    is mounted; there its rays start.

    **Reward**: 0. **Terminated** after the last record, never truncated. **Randomness**: where a
    `segment` begins, drawn at `reset`. **Options** of `reset`: none.

    Args:
        log: path of a log, or of its parts (see `deqmcl_gym.logs.read` for formats), or a
            `deqmcl_gym.logs.Log`.
        map: a map, the path of its yaml, its corners as for `floor_plan` of `Room-v0`, or None.
            The env itself needs no map; localizers find it as `env.unwrapped.floor_plan`.
        reference: path of a TUM trajectory in the frame of the map.
        segment: length of an episode by odometry. Its first record is drawn at reset, from those
            that are followed by such a stretch, with a reference at each record if the log has one.
            None plays the whole log.
        plan: source of planned actions: "odometry" or "none".
        horizon: number of planned actions that `info` shows.
        every: (distance, angle rad) or "0.2m,5deg": play only records this far apart, by odometry,
            like AMCL's update_min_d and update_min_a; None plays all.
        max_beams: largest number of beams used, spread evenly; None uses all.
        start: index of the first record, from 0.
        length: number of records from there on, before `every`; None is all.
        on_mismatch: what an action other than the recorded one does: "error" refuses it, "ignore"
            plays the log.
        render_mode: None, "rgb_array" or "human".
        reading: further arguments of `deqmcl_gym.logs.read`: `{"scan_topic": "/scan"}`.
        unknown: what unknown cells of a map that is given by the path of its yaml count as:
            "obstacle" (as None), "transparent" (beams pass, robots do not), "free", or an occupancy
            from 0 to 1; see `deqmcl_gym.GridMap`.
        radius: of the robot, for localizers, as logs do not contain it; None is 0.16 m.
        changed_walls: what if the map were out of date: inner walls of it are changed, as the
            argument of this name says of `Room-v0`'s world, with a `seed` (0) for what is drawn:
            `{"share": 0.3, "seed": 1}`. Walls shifted and added keep off the reference.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        *,
        log: str | PathLike[str] | Sequence[str | PathLike[str]] | logs.Log | None = None,
        map: Any = None,  # noqa: A002  # everybody calls it that
        reference: str | PathLike[str] | logs.Trajectory | None = None,
        segment: float | None = None,
        plan: str = "odometry",
        horizon: int = 50,
        every: str | tuple[float, float] | None = None,
        max_beams: int | None = None,
        start: int = 0,
        length: int | None = None,
        on_mismatch: str = "error",
        reading: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        unknown: str | float | None = None,
        radius: float | None = None,
        changed_walls: Mapping[str, Any] | None = None,
        **others: Any,
    ) -> None:
        validation.check_arguments(others, set(signature(LogEnv).parameters) - {"others"})
        if log is None:
            raise InputError("there is no log: give log=…, the path of one.")
        self._on_mismatch = one_of("on_mismatch", on_mismatch, ("error", "ignore"))
        self._horizon = integer("horizon", horizon, low=1, high=100_000)
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.log = whole = log_of(log, reference, reading).segment(start, length)
        if every is not None:
            self.log = self.log.spaced(*spacing("every", every, whole.unit))
        if max_beams is not None:
            self.log = self.log.with_beams(max_beams)
        if len(self.log) < 2:
            raise InputError(
                f"{self.log.source} has {len(self.log)} record to play (of {len(whole):,} in the "
                "segment), but needs 2 or more: choose a longer segment or a smaller every."
            )
        self._map = map_of(map, unknown, self.log)
        self.lidar, usual = self.log.scanner, _RADIUS * pixel(self.log.unit)
        if changed_walls is not None:
            truth, records = self.log.reference, self.log.referenced
            driven = np.empty((0, 3)) if truth is None else truth[records]
            self._map = map_changed(self.floor_plan, changed_walls, driven[:, :2], usual)
        self.radius = usual if radius is None else number("radius", radius, low=0)
        self._segments = log_segments(self.log, segment)
        self._actions = self.log.increments.astype(np.float32)
        self._shows = one_of("plan", plan, ("odometry", "none")) == "odometry"
        most = np.maximum(np.abs(self._actions).max(axis=0), np.float32(1e-6))
        self.action_space = gym.spaces.Box(-most, most, dtype=np.float32)
        reach = self.lidar.max_range
        self._scans = np.nan_to_num(self.log.ranges, nan=3 * reach, posinf=2 * reach)
        most = np.float32(3 * reach)
        self.observation_space = gym.spaces.Box(0.0, most, (self.lidar.beams,), np.float32)
        self._first = self._last = self._step = -1

    @property
    def floor_plan(self) -> Map:
        """The map, for localizers; UnavailableError without one."""
        if self._map is None:
            raise validation.UnavailableError("the env was made without a map: give map=….")
        return self._map

    @property
    def expected_start(self) -> Pose:
        """The reference pose of this episode's first record; UnavailableError without one."""
        at = self.log[self._begun - self.elapsed_steps].reference
        if at is None:
            raise validation.UnavailableError(
                f"{self.log.source} has no reference pose where it begins: give a reference."
            )
        return at

    @property
    def record(self) -> logs.Record:
        """The last record played, with its reference pose, for scoring."""
        return self.log[self._begun]

    @property
    def elapsed_steps(self) -> int:
        """Steps since reset."""
        return self._begun - self._first

    @property
    def next_action(self) -> Singles:
        """The recorded increment of the next step, (3,) float32; NoEpisodeError after the last."""
        if self._begun >= self._last:
            raise NoEpisodeError("the log has ended: call reset() before step().")
        action: Singles = self._actions[self._begun]
        return action.copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Singles, dict[str, Any]]:
        """Go to the first record, of a newly drawn segment if there are several."""
        check_options(options)
        super().reset(seed=None if seed is None else integer("seed", seed))
        drawn = self.np_random.integers(len(self._segments)) if len(self._segments) > 1 else 0
        self._first, self._last = self._segments[drawn].tolist()
        self._step = self._first
        return self._scans[self._step].copy(), self._info(np.zeros(3, np.float32))

    def step(self, action: ArrayLike) -> StepResult:
        """Play the next record."""
        recorded = self.next_action
        given = validation.array("the action (forward, left, turn)", action, (3,))
        if self._on_mismatch == "error" and np.abs(given - recorded).max() > _SAME:
            sent, right = (f"({', '.join(map('{:.6g}'.format, a))})" for a in (given, recorded))
            raise InputError(
                f"the action of step {self.elapsed_steps + 1} is {sent}, but {right} was recorded: "
                'give env.unwrapped.next_action, or make the env with on_mismatch="ignore".'
            )
        self._step += 1
        ended = self._step == self._last
        return self._scans[self._step].copy(), 0.0, ended, False, self._info(recorded)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of map, path and last scan, (h, w, 3) RGB.

        Without a reference, it is in the frame of the odometry and has no map.
        """
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array").')
            return None
        from deqmcl_gym.world.drawing import LIGHT_BLUE, Drawing, View

        step, log, scale = self._begun, self.log, 2.0
        referenced = log.referenced
        poses = log.odometry if log.reference is None else log.reference
        at = referenced if referenced.size else np.arange(len(log))
        ground = self._map if referenced.size else None
        if ground is None:  # the area around odometry that may be far from (0, 0)
            poses, around = poses - np.array([*poses[at[0], :2], 0.0]), 50 * pixel(log.unit)
            (x0, y0), (x1, y1) = poses[at, :2].min(0) - around, poses[at, :2].max(0) + around
            ground = PolygonMap(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), unit=log.unit)
            scale = min(scale, _SIDE * pixel(log.unit) / max(x1 - x0, y1 - y0))
        drawing = Drawing(View(ground, scale)).path(poses[at], LIGHT_BLUE)
        if not referenced.size or step in referenced:
            drawing.beams(self.lidar.rays(poses[step]), log.ranges[step])
            drawing.robot(poses[step], self.radius)
        return drawing.number(self.elapsed_steps).image

    @property
    def _begun(self) -> int:
        if self._step < 0:
            raise NoEpisodeError
        return self._step

    def _info(self, action: Singles) -> dict[str, Any]:
        step = self._step
        count = min(self._horizon, self._last - step) if self._shows else 0
        planned = np.zeros((self._horizon, 3), np.float32)
        planned[:count] = self._actions[step : step + count]
        info: dict[str, Any] = {
            "planned_actions": planned,
            "planned_count": np.int64(count),
            "command": action,
            "collided": np.float64(0),
            "is_success": np.float64(step == self._last),
        }
        if self.log.reference is not None:
            known = np.isfinite(self.log.reference[step])
            info["truth"] = np.where(known, self.log.reference[step], np.inf)
        return info
