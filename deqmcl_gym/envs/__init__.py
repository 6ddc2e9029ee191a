"""RoomEnv: the Gymnasium environment, wired from the parts in ``deqmcl_gym.world``.

In the other files: many rooms at once, logs, tasks of acting, and wrappers.
"""

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics import Pose, Singles
from deqmcl_gym.validation import InputError, NoEpisodeError, integer, one_of, pose
from deqmcl_gym.world import Driver, Lap, MotionNoise, Robot, Route, Start, Stream, World
from deqmcl_gym.world.course import Course, check_free
from deqmcl_gym.world.differences import ChangedWalls, Clutter, Glass
from deqmcl_gym.world.driver import FixedPlan
from deqmcl_gym.world.episode import Episode, contacts_of
from deqmcl_gym.world.people import People
from deqmcl_gym.world.rules import RoomInfo, RoomRules, StepResult, check_options

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing, View


class RoomEnv(gym.Env[Any, Singles]):
    """A disc-shaped robot drives a planned lap through a room and scans it with a lidar.

    ```python
    import gymnasium as gym, deqmcl_gym

    env = gym.make("deqmcl_gym/Room-v0", preset="sharp")  # or "deqmcl_gym/Sharp-v0"
    ranges, info = env.reset(seed=0)
    ended = False
    while not ended:
        action = info["planned_actions"][0]
        ranges, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    ```

    **Description**: the robot knows its plan and the map, not its pose. In each step it turns on
    the spot, then drives straight ahead, both with noise; the first contact with a wall ends the
    drive. Then a scan is taken. docs/environment.md has every detail.

    **Action Space**: `Box([0, -π/4], [10, π/4], (2,), float32)`: a distance (px) to drive after a
    turn (rad). Anything else is refused, never clamped. For actions in [-1, 1] wrap the env in
    `gymnasium.wrappers.RescaleAction(env, -1, 1)`.

    **Observation Space**: `Box(0, 400, (beams,), float32)`: ranges (px). With `observation="dict"`
    also `plan` (h, 2), the actions to come, unless `plan=False`; `progress` (1,), along the lap;
    `clock` (1,), the share of the plan's steps that are done; `goal` (2,), the end of a route.
    `info` has the plan too, and under `truth` the true pose.

    **Rewards**: progress along the lap in px up to the goal, -10 for a contact, +100 at the goal.

    **Starting State**: the bottom centre of the lap, heading along it; drawn around that pose if
    `start.sd_position` or `start.sd_heading` is not 0.

    **Episode End**: terminated when the robot, once round, touches the line it started from, at
    any point of it; never with `ends_at_goal=False`. Truncated when the plan is used up before, or
    after `max_episode_steps` (408; none in `Journey-v1`).

    **Version History**: v0, as of 0.2.0 with this reward and end.

    Args:
        preset: the world to start from: "paper", "matched", "sharp" or "guided".
        world: a ``World`` to start from, instead of a preset.
        floor_plan: the map: corners (`outer`, `obstacles`, `unit`), the path of a ROS map's yaml or
            of such corners as JSON, or an `office`; None: the preset's.
        lidar: beams, field of view, range and noise. This and the following parts are objects, or
            JSON-able changes to the preset's.
        robot, noise, start, lap: see ``deqmcl_gym.world``.
        driver: follows the path from the true pose, with a new plan at every step.
        route: a start and a goal, drawn in each episode, instead of the lap.
        clutter: boxes and pillars that are not on the map.
        changed_walls: inner walls that are not as on the map.
        people: people who walk about.
        glass: inner walls that do not reflect all beams.
        horizon: rows of `planned_actions`; None: all of the plan.
        ends_at_goal: whether the episode ends when the lap is done or the goal reached.
        observation: "scan", or "dict" for scan, plan, progress, clock and the goal of a route.
        plan: False leaves the plan out of the dict: with it, its first row is the solution.
        goal: in the dict, "map": x and y; "relative": distance and bearing from the true pose.
        render_mode: None, "rgb_array" or "human".

    Attributes:
        floor_plan: the map m, for localizers too; that of this episode.
        building: seed of this episode's office, where each draws one; else None.
        rules: what all its episodes share.
        before_step: what happens in the next step before the robot moves, by whose it is.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}

    def __init__(
        self,
        *,
        preset: str = "paper",
        world: World | None = None,
        floor_plan: Map | dict[str, Any] | str | None = None,
        lidar: Lidar | dict[str, Any] | None = None,
        robot: Robot | dict[str, Any] | None = None,
        noise: MotionNoise | dict[str, Any] | None = None,
        start: Start | dict[str, Any] | None = None,
        lap: Lap | dict[str, Any] | None = None,
        driver: Driver | dict[str, Any] | str | None = None,
        route: Route | dict[str, Any] | str | None = None,
        clutter: Clutter | dict[str, Any] | str | None = None,
        changed_walls: ChangedWalls | dict[str, Any] | str | None = None,
        people: People | dict[str, Any] | str | None = None,
        glass: Glass | dict[str, Any] | str | None = None,
        horizon: int | None = None,
        ends_at_goal: bool = True,
        observation: str = "scan",
        plan: bool = True,
        goal: str = "map",
        render_mode: str | None = None,
        **unknown: Any,
    ) -> None:
        self.rules = rules = RoomRules.of(
            preset=preset, world=world, horizon=horizon, ends_at_goal=ends_at_goal,
            floor_plan=floor_plan, lidar=lidar, robot=robot, noise=noise, start=start, lap=lap,
            driver=driver, route=route, clutter=clutter, changed_walls=changed_walls,
            people=people, glass=glass, observation=observation, plan=plan, goal=goal, **unknown,
        )  # fmt: skip
        self.world = rules.world
        self.floor_plan, self.lidar = self.world.floor_plan, self.world.lidar
        self._walls = contacts_of(self.world)
        self.building: int | None = None
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
            _ = rules.view  # refuses a room too large for a picture
        self.render_mode = render_mode
        self.observation_space = rules.observation_space
        self.action_space = rules.commands.space
        self._begun: Episode | None = None
        self._number = -1  # of the episode since the last seed
        self.before_step: dict[Hashable, Callable[[], None]] = {}

    @property
    def radius(self) -> float:
        """Radius of the robot's disc."""
        return self.world.robot.radius

    @property
    def expected_start(self) -> Pose:
        """The planned start (x, y, θ), which need not be the true one."""
        return self.course.start

    @property
    def plan(self) -> Singles:
        """The actions planned for this episode, done and to come, (T, 2) float32.

        For a driver, they are those without noise from the expected start. In a world with a route,
        NoEpisodeError before the first reset.
        """
        plan = self.rules.plan if self._is_lap_ahead else self._episode.plan
        return plan.actions.copy()

    @property
    def course(self) -> Course:
        """Lap or route: its path, start, and actions as planned beforehand; see ``plan``."""
        return self.rules.course if self._is_lap_ahead else self._episode.course

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
        return self._episode.begun.streams(stream, twin)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; without a seed, the next one in the order of the last seed.

        If the seed is refused, or no start is free, the last episode continues.
        """
        check_options(options)
        if seed is not None:
            root, number = integer("seed", seed), 0
        elif self.np_random_seed >= 0:
            root, number = self.np_random_seed, self._number + 1
        else:  # np_random was set, and its seed is unknown
            root, number = int(self.np_random.integers(2**63)), 0
        rules, building = self.rules.of_episode(root, number)
        walls = self._walls if building is None else contacts_of(rules.world)
        episode = Episode(rules, walls, seed=root, number=number)
        super().reset(seed=None if seed is None else root)
        self.rules, self._walls, self.building = rules, walls, building
        self.world, self.floor_plan = rules.world, rules.world.floor_plan
        self._begun, self._number = episode, number
        self.before_step = {}
        nothing = np.zeros(2, np.float32)
        info = self._info(episode, nothing, collided=False)
        return self._seen(episode, info), info

    def step(self, action: Singles) -> StepResult:
        """Turn, then drive; stop at the first contact with a wall."""
        episode = self._begun
        if episode is None or episode.ended:
            state = "has not begun" if episode is None else "has ended"
            raise RuntimeError(f"the episode {state}: call reset() before step().")
        happening, self.before_step = self.before_step, {}
        command = self.rules.commands.checked(action)
        for happen in happening.values():
            happen()
        reward, collided = episode.advance(*command.tolist())
        info = self._info(episode, command, collided)
        given_up = not (info["planned_count"] or episode.done)
        episode.ended = episode.done or given_up
        return self._seen(episode, info), reward, episode.done, given_up, info

    def place(self, at: Pose, noticed: bool = True) -> None:
        """Put the robot at a free pose; the reward ignores the jump.

        Unless it is ``noticed``, a driver does not replan. At its goal already, he refuses.
        """
        self._episode.place(self.checked_pose("the pose", at), noticed)

    def elsewhere(self, rng: np.random.Generator) -> Pose:
        """Draw a free pose: anywhere for a lap; for a route, as its start is drawn."""
        return self._episode.there.elsewhere(self.course, rng)

    def replace_plan(self, actions: Singles) -> None:
        """Let ``actions`` (k, 2) follow the next step, instead of what was planned after it."""
        episode = self._episode
        rows = self.checked_plan("the plan", actions)
        assert isinstance(episode.plan, FixedPlan)  # without a driver
        episode.plan = episode.plan.replaced(episode.step + 1, rows)

    def checked_pose(self, what: str, at: Pose) -> Pose:
        """Return a pose where the robot is clear of the walls, else refuse it."""
        given = pose(what, at)
        check_free(what, given, self.world if self._begun is None else self._begun.there.world)
        return given

    def checked_plan(self, what: str, actions: ArrayLike) -> Singles:
        """Return actions (k, 2) that can replace the plan's, float32, else refuse them."""
        if self.world.driver is not None:
            raise InputError(
                "a driver makes the plan at every step, so it cannot be replaced: "
                "choose a world without a driver."
            )
        return self.rules.commands.checked_plan(what, actions)

    def render(self) -> NDArray[np.uint8] | None:
        """Return the world as it is, (h, w, 3) RGB, or None without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array").')
            return None
        if self._begun is None:
            raise RuntimeError("there is nothing to render yet: call reset() before render().")
        episode = self._begun
        ground, course = self.picture(self.rules.view), episode.course
        return self.rules.picture(ground, course, episode.pose, episode.scan, episode.step)

    def picture(self, view: "View") -> "Drawing":
        """Draw what is there, without the robot, as in ``render``."""
        return self._episode.begun.picture(view, self._episode.crowd)

    @property
    def _is_lap_ahead(self) -> bool:
        return self._begun is None and self.rules.journeys is None

    def _info(self, episode: Episode, command: Singles, collided: bool) -> dict[str, Any]:
        planned, count = episode.plan.after(episode.underway)
        info: RoomInfo = {
            "planned_actions": planned,
            "planned_count": np.int64(count),
            "command": command,
            "collided": np.float64(collided),
            "is_success": np.float64(episode.done),
            "truth": np.array(episode.pose),
        }
        if episode.course.goal is not None and self.rules.observation == "scan":
            info["goal"] = np.array(episode.course.goal)
        if self.building is not None:
            info["building"] = np.int64(self.building)
        return cast("dict[str, Any]", info)

    def _seen(self, episode: Episode, info: dict[str, Any]) -> Any:
        if self.rules.observation == "scan":
            return episode.scan.copy()
        covered = episode.progress / episode.course.path.length
        elapsed = episode.step / episode.plan.limit
        goal, pose = episode.course.goal, episode.pose
        planned = info["planned_actions"]
        return self.rules.seen(episode.scan, planned, covered, elapsed, goal, pose)

    @property
    def _episode(self) -> Episode:
        if self._begun is None:
            raise NoEpisodeError
        return self._begun
