"""RoomEnv: the Gymnasium environment. Wiring only; each part has a file of its own."""

from typing import Any, SupportsFloat, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.envs.info import RoomInfo, check_no_options
from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.validation import InputError, integer, one_of, pose
from deqmcl_gym.world.config import Driver, Lap, MotionNoise, Robot, Start
from deqmcl_gym.world.course import check_free
from deqmcl_gym.world.episode import Episode
from deqmcl_gym.world.path import Pose
from deqmcl_gym.world.physics import contacts_of
from deqmcl_gym.world.plan import FixedPlan, Plan
from deqmcl_gym.world.setting import Setting
from deqmcl_gym.world.streams import Stream


class RoomEnv(gym.Env[Singles, Singles]):
    """A robot drives a planned counterclockwise lap through a room and sees it by lidar.

    docs/environment.md describes spaces, info, reward, end of episode and arguments.

    Attributes:
        floor_plan: the map m, for localizers too.
        lidar: the sensor's geometry and noise, for localizers too.
        world: all parts of the world, as configured.
        course: the lap: its path, start, and actions as planned beforehand.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}

    def __init__(
        self,
        *,
        preset: str = "paper",
        floor_plan: Map | dict[str, Any] | str | None = None,
        lidar: Lidar | dict[str, Any] | None = None,
        robot: Robot | dict[str, Any] | None = None,
        noise: MotionNoise | dict[str, Any] | None = None,
        start: Start | dict[str, Any] | None = None,
        lap: Lap | dict[str, Any] | None = None,
        driver: Driver | dict[str, Any] | str | None = None,
        horizon: int | None = None,
        ends_at_goal: bool = True,
        render_mode: str | None = None,
    ) -> None:
        """Make the env; every part may be given as JSON-able changes to the preset's.

        Args:
            preset: name of the world to start from.
            floor_plan: the map: ``outer`` corners, ``obstacles`` and their ``unit``, "px" or "m";
                or the path of a ROS map's yaml file.
            lidar: beams, field of view, range and noise.
            robot: radius and largest action.
            noise: motion noise of the world.
            start: pose at reset and its spread.
            lap: step lengths, or waypoints of the planned path.
            driver: who follows that path from the true pose, and plans anew at every
                step; "none" takes the preset's away.
            horizon: how many planned actions ``info`` shows; None shows the whole rest.
            ends_at_goal: end the episode when the lap is done, even if the plan has steps left.
            render_mode: None or "rgb_array".
        """
        self._setting = setting = Setting.of(
            preset=preset, horizon=horizon, ends_at_goal=ends_at_goal,
            floor_plan=floor_plan, lidar=lidar, robot=robot, noise=noise, start=start, lap=lap,
            driver=driver,
        )  # fmt: skip
        self.world, self.course = setting.world, setting.course
        self.floor_plan, self.lidar = self.world.floor_plan, self.world.lidar
        self._walls = contacts_of(self.world)
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
            setting.drawing()  # refuses a room too large for a picture
        self.render_mode = render_mode
        self.observation_space = setting.observation_space
        self.action_space = setting.commands.space
        self._begun: Episode | None = None
        self._number = -1  # of the episode since the last seed

    @property
    def plan(self) -> Singles:
        """The actions planned for this episode, done and to come, (T, 2) float32.

        Of a driver: those of a lap without noise from the expected start.
        """
        plan = self._setting.plan if self._begun is None else self._begun.plan
        return plan.actions

    @property
    def elapsed_steps(self) -> int:
        """Steps carried out since reset."""
        return self._episode.step

    @property
    def pose(self) -> Pose:
        """The true pose (x, y, θ)."""
        return self._episode.pose

    def stream(self, stream: Stream, twin: int = 0) -> np.random.Generator:
        """Return the random stream of one source in this episode, from its beginning."""
        return self._episode.stream(stream, twin)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Singles, dict[str, Any]]:
        """Begin an episode; without a seed, the next one in the order of the last seed.

        Raises:
            InputError: a bad seed, an option, or no free start. The last episode goes on.
        """
        check_no_options(options)
        root = self.np_random_seed if seed is None else integer("seed", seed)
        number = self._number + 1 if seed is None else 0
        episode = Episode(self._setting, self._walls, seed=root, number=number)
        super().reset(seed=None if seed is None else root)
        self._begun, self._number = episode, number
        nothing = np.zeros(2, np.float32)
        return episode.scan.copy(), _info(episode, nothing, collided=False)

    def step(self, action: Singles) -> tuple[Singles, SupportsFloat, bool, bool, dict[str, Any]]:
        """Turn, then drive; stop at the first contact with a wall."""
        episode = self._begun
        if episode is None or episode.ended:
            state = "has not begun" if episode is None else "has ended"
            raise RuntimeError(f"the episode {state}: call reset() before step().")
        command = self._setting.commands.checked(action)
        progress, collided = episode.advance(*command.tolist())
        reward = progress - self._setting.penalty * collided
        info = _info(episode, command, collided)
        used_up = info["planned_count"] == 0
        episode.ended = used_up or (self._setting.ends_at_goal and episode.lap_done)
        return episode.scan.copy(), reward, episode.ended, False, info

    def place(self, at: Pose) -> None:
        """Put the robot at a free pose, without telling anyone; the reward ignores the jump.

        Raises:
            InputError: the robot would touch a wall there.
        """
        self._episode.place(self.checked_pose("the pose", at))

    def replace_plan(self, actions: Singles) -> None:
        """Let ``actions`` (k, 2) follow the next step, instead of what was planned after it.

        Raises:
            InputError: wrong shape, NaN, an action outside the action space, or the plan is a
                driver's.
        """
        episode = self._episode
        rows = self.checked_plan("the plan", actions)
        episode.plan = _replaceable(episode.plan).replaced(episode.step + 1, rows)

    def checked_pose(self, what: str, at: Pose) -> Pose:
        """Return a pose where the robot is clear of the walls, else refuse it."""
        given = pose(what, at)
        check_free(what, given, self.world)
        return given

    def checked_plan(self, what: str, actions: ArrayLike) -> Singles:
        """Return actions (k, 2) that can replace the plan's, float32, else refuse them."""
        _replaceable(self._setting.plan)
        return self._setting.commands.checked_plan(what, actions)

    def render(self) -> NDArray[np.uint8] | None:
        """Return the world as it is, (h, w, 3) RGB, or None without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array").')
            return None
        if self._begun is None:
            raise RuntimeError("there is nothing to render yet: call reset() before render().")
        episode = self._begun
        return self._setting.picture(episode.pose, episode.scan, episode.step)

    @property
    def _episode(self) -> Episode:
        if self._begun is None:
            raise RuntimeError("the episode has not begun: call reset() first.")
        return self._begun


def _info(episode: Episode, command: Singles, collided: bool) -> dict[str, Any]:
    planned, count = episode.plan.after(episode)
    info: RoomInfo = {
        "planned_actions": planned,
        "planned_count": count,
        "action": command,
        "collided": collided,
        "truth": np.array(episode.pose),
    }
    return cast("dict[str, Any]", info)


def _replaceable(plan: Plan) -> FixedPlan:
    if not isinstance(plan, FixedPlan):
        raise InputError(
            "a driver makes the plan at every step, so it cannot be replaced: "
            "choose a world without a driver."
        )
    return plan
