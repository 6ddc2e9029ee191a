"""RoomEnv: the Gymnasium environment. Wiring only; each part has a file of its own."""

import contextlib
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from deqmcl_gym import validation
from deqmcl_gym.config import Lap, MotionNoise, Robot, Start
from deqmcl_gym.floorplan import FloorPlan, Lidar
from deqmcl_gym.info import RoomInfo
from deqmcl_gym.lap import Course
from deqmcl_gym.lidar import LidarSensor
from deqmcl_gym.path import Pose
from deqmcl_gym.physics import Physics
from deqmcl_gym.presets import WORLDS
from deqmcl_gym.seeding import NormalRows, Stream, episode_stream
from deqmcl_gym.validation import InputError, integer, one_of, pose

COLLISION_PENALTY = 10.0  # px of progress
_START_TRIES = 1000

Scan = NDArray[np.float32]


class RoomEnv(gym.Env[Scan, NDArray[np.float32]]):
    """A robot drives a planned counterclockwise lap through a room and sees it by lidar.

    docs/environment.md describes spaces, info, reward, end of episode and arguments.

    Attributes:
        floor_plan: the map m, for localizers too.
        lidar: the sensor's geometry and noise, for localizers too.
        world: all parts of the world, as configured.
        course: the lap as planned at reset: path, start and actions.
        plan: the actions planned for this episode, done and to come, (T, 2) float32.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}

    def __init__(
        self,
        *,
        preset: str = "paper",
        floor_plan: FloorPlan | dict[str, Any] | None = None,
        lidar: Lidar | dict[str, Any] | None = None,
        robot: Robot | dict[str, Any] | None = None,
        noise: MotionNoise | dict[str, Any] | None = None,
        start: Start | dict[str, Any] | None = None,
        lap: Lap | dict[str, Any] | None = None,
        horizon: int | None = None,
        ends_at_goal: bool = True,
        render_mode: str | None = None,
    ) -> None:
        """Make the env; every part may be given as JSON-able changes to the preset's.

        Args:
            preset: name of the world to start from.
            floor_plan: the map: ``outer`` corners and ``obstacles``, px.
            lidar: beams, field of view, range and noise.
            robot: radius and largest action.
            noise: motion noise of the world.
            start: pose at reset and its spread.
            lap: step lengths, or waypoints of the planned path.
            horizon: how many planned actions ``info`` shows; None shows the whole rest.
            ends_at_goal: end the episode when the lap is done, even if the plan has steps left.
            render_mode: None or "rgb_array".
        """
        self.world = WORLDS[one_of("preset", preset, WORLDS)].changed(
            floor_plan=floor_plan, lidar=lidar, robot=robot, noise=noise, start=start, lap=lap
        )
        self.floor_plan = self.world.floor_plan
        self.lidar = self.world.lidar
        self.course = Course.of(self.world)
        self._check_start()
        self.plan = self.course.actions
        self._horizon = len(self.plan) if horizon is None else integer("horizon", horizon, low=1)
        self._ends_at_goal = ends_at_goal
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.observation_space = gym.spaces.Box(
            0.0, self.lidar.max_range, (self.lidar.beams,), np.float32
        )
        self.action_space = gym.spaces.Box(
            np.array([0.0, -self.world.robot.max_turn], np.float32),
            np.array([self.world.robot.max_distance, self.world.robot.max_turn], np.float32),
        )
        self._episode = -1  # none begun
        self._running = False

    @property
    def elapsed_steps(self) -> int:
        """Steps carried out since reset."""
        self._require_begun()
        return self._step

    def stream(self, stream: Stream) -> np.random.Generator:
        """Return the random stream of one source in this episode, from its beginning."""
        return episode_stream(self.np_random_seed, self._episode, stream)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Scan, dict[str, Any]]:
        """Begin an episode; without a seed, the next one in the order of the last seed."""
        if seed is not None:
            seed = integer("seed", seed)
        for key in options or {}:
            one_of("reset option", key, ())
        super().reset(seed=seed)
        self._warn_of_short_limit()
        self._episode = 0 if seed is not None else self._episode + 1
        self._motion_noise = NormalRows(self.stream(Stream.MOTION), 2)
        self._sensor = LidarSensor(self.floor_plan, self.lidar, self.stream(Stream.SENSOR))
        x, y, self._heading = self._drawn_start()
        self._physics = Physics(self.floor_plan, self.world.robot.radius, (x, y))
        self._running = True
        self._step = 0
        self.plan = self.course.actions
        self._arc = self.course.path.arc((x, y))
        self._start_position = (x, y)
        self._progress = 0.0
        self._scan = self._sensor.scan(self.pose)
        return self._scan.copy(), self._info(np.zeros(2, np.float32), collided=False)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Scan, SupportsFloat, bool, bool, dict[str, Any]]:
        """Turn, then drive; stop at the first contact with a wall."""
        if not self._running:
            ended = "has ended" if self._episode >= 0 else "has not begun"
            raise RuntimeError(f"the episode {ended}: call reset() before step().")
        command = self._checked(action)
        collided = self._move(*command.tolist())
        self._step += 1
        advance = self._advance()
        self._progress += advance
        reward = advance - COLLISION_PENALTY * collided
        terminated = self._step >= len(self.plan) or (self._ends_at_goal and self._lap_done())
        self._running = not terminated
        self._scan = self._sensor.scan(self.pose)
        return self._scan.copy(), reward, terminated, False, self._info(command, collided)

    @property
    def pose(self) -> Pose:
        """The true pose (x px, y px, θ rad)."""
        self._require_begun()
        return (*self._physics.position, self._heading)

    def place(self, at: Pose) -> None:
        """Put the robot at a free pose, without telling anyone; the reward ignores the jump.

        Raises:
            InputError: the robot would touch a wall there.
        """
        self._require_begun()
        x, y, heading = pose("the pose", at)
        if not self._fits((x, y)):
            raise InputError(_no_room("the pose", (x, y, heading), self.world.robot.radius))
        self._physics.place((x, y))
        self._heading = heading
        self._arc = self.course.path.arc((x, y))

    def replace_plan(self, actions: NDArray[np.float32]) -> None:
        """Let ``actions`` (k, 2) follow the next step, instead of what was planned after it.

        Raises:
            InputError: wrong shape, NaN, or an action outside the action space.
        """
        rows = validation.actions("the plan", actions).astype(np.float32)
        for row in rows:
            self._checked(row)
        self.plan = np.vstack([self.plan[: self._step + 1], rows])

    def render(self) -> NDArray[np.uint8] | None:
        """Return the world as it is, (h, w, 3) RGB, or None without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array").')
            return None
        if self._episode < 0:
            raise RuntimeError("there is nothing to render yet: call reset() before render().")
        from deqmcl_gym.drawing import LIGHT_BLUE, Drawing, View

        drawing = Drawing(View(self.floor_plan))
        drawing.path([*self.course.path.corners, self.course.path.corners[0]], LIGHT_BLUE)
        drawing.beams(self.pose, self.lidar.bearings, self._scan)
        return drawing.robot(self.pose, self.world.robot.radius).number(self._step).image

    def _require_begun(self) -> None:
        if self._episode < 0:
            raise RuntimeError("the episode has not begun: call reset() first.")

    def _checked(self, action: Any) -> NDArray[np.float32]:
        command = np.empty(0, np.float32)
        with contextlib.suppress(ValueError), np.errstate(over="ignore"):
            given = np.asarray(action)
            if given.dtype.kind in "fiu":  # neither words nor complex numbers nor truth values
                command = given.astype(np.float32)
        if command.shape != (2,) or not self.action_space.contains(command):
            (low, left), (high, right) = self.action_space.low, self.action_space.high  # type: ignore[attr-defined]
            raise InputError(
                f"the action is {action!r}, but must be two numbers: a distance from {low:g} to "
                f"{high:g} px and a turn from {left:.4g} to {right:.4g} rad."
            )
        return command

    def _move(self, distance: float, turn: float) -> bool:
        noise_distance, noise_turn = self._motion_noise.next().tolist()
        sd_turn = self.world.noise.turn * abs(turn) + self.world.noise.drift * distance
        heading = self._heading + turn + sd_turn * noise_turn
        self._heading = (heading + np.pi) % (2 * np.pi) - np.pi
        driven = distance * (1 + self.world.noise.drive * noise_distance)
        return self._physics.drive(driven, self._heading)

    def _advance(self) -> float:
        """Return the way made along the path since it was last asked, px."""
        before, self._arc = self._arc, self.course.path.arc(self._physics.position)
        return self.course.path.advance(before, self._arc)

    def _lap_done(self) -> bool:
        (x0, y0), (x, y) = self._start_position, self._physics.position
        back = (x - x0) ** 2 + (y - y0) ** 2 <= self.world.robot.radius**2
        return back and round(self._progress / self.course.path.length) >= 1

    def _drawn_start(self) -> Pose:
        x, y, heading = self.course.start
        rng = self.stream(Stream.START)
        start = self.world.start
        sd = np.array([start.sd_position, start.sd_position, start.sd_heading])
        for _ in range(_START_TRIES):
            dx, dy, turn = (sd * rng.standard_normal(3)).tolist()
            if self._fits((x + dx, y + dy)):
                return x + dx, y + dy, heading + turn
        raise InputError(
            f"none of {_START_TRIES} starts drawn around ({x:g}, {y:g}) is free: give a smaller "
            "start.sd_position."
        )

    def _fits(self, position: tuple[float, float]) -> bool:
        return bool(self.floor_plan.free([position], self.world.robot.radius)[0])

    def _check_start(self) -> None:
        if not self._fits(self.course.start[:2]):
            raise InputError(_no_room("start.pose", self.course.start, self.world.robot.radius))

    def _warn_of_short_limit(self) -> None:
        limit = self.spec.max_episode_steps if self.spec is not None else None
        if limit is not None and limit < len(self.course.actions):
            gym.logger.warn(
                f"the lap has {len(self.course.actions)} steps, but the time limit is {limit}: "
                f"give gym.make(..., max_episode_steps={2 * len(self.course.actions)})."
            )

    def _info(self, command: NDArray[np.float32], collided: bool) -> dict[str, Any]:
        rest = self.plan[self._step : self._step + self._horizon]
        planned = np.zeros((self._horizon, 2), np.float32)
        planned[: len(rest)] = rest
        info = RoomInfo(
            planned_actions=planned,
            planned_count=len(rest),
            action=command,
            collided=collided,
            truth=np.array(self.pose),
        )
        return dict(info)


def _no_room(what: str, at: Pose, radius: float) -> str:
    x, y, heading = at
    return (
        f"{what} is ({x:g}, {y:g}, {heading:g}), where a robot of radius {radius:g} px touches a "
        "wall or stands outside: give a pose in free space."
    )
