"""Episode: a robot in a world, from reset to the end of its plan."""

import numpy as np

from deqmcl_gym.world.course import Pose, wrapped
from deqmcl_gym.world.driver import GuidedPlan
from deqmcl_gym.world.path_kernels import judged
from deqmcl_gym.world.physics import Contacts, Physics
from deqmcl_gym.world.rules import RoomRules
from deqmcl_gym.world.sensor import LidarSensor, Stream, episode_stream


class Episode:
    """All state that changes between two resets.

    Attributes:
        course: the path, and the actions planned for it.
        plan: the actions to come.
        step: steps carried out.
        pose: the true one (x, y, θ).
        arc: arc length at which the robot is on the path.
        way: distance along the path since reset, jumps included.
        progress: the same without jumps.
        done: whether the task is done.
        ended: whether the episode has ended.
        scan: the last one, (B,).
    """

    def __init__(self, rules: RoomRules, walls: Contacts, *, seed: int, number: int) -> None:
        """Begin the ``number``-th episode after seeding, and take its first scan.

        Raises:
            InputError: no drawn start is free, or no route was found.
        """
        world = rules.world
        self._rules = rules
        self.course, self.plan = rules.begun(seed, number)
        self._seed, self._number = seed, number
        self._noise = world.noise
        self._motion = self.stream(Stream.MOTION)
        self._sensor = LidarSensor(world.floor_plan, world.lidar, self.stream(Stream.SENSOR))
        self.pose = rules.start(self.course, seed, number)
        self._physics = Physics(walls, self.pose[:2])
        self.arc = rules.first_arc(self.course, self.pose[:2])
        self.way = self.progress = 0.0
        self.step, self.done, self.ended = 0, False, False
        self.scan = self._sensor.scan(self.pose)

    def stream(self, stream: Stream, twin: int = 0) -> np.random.Generator:
        """Return the random stream of one source in this episode, from its beginning."""
        return episode_stream(self._seed, self._number, stream, twin)

    def place(self, pose: Pose, noticed: bool = True) -> None:
        """Put the robot at a pose; this does not count as progress.

        Args:
            pose: (x, y, θ).
            noticed: whether a driver notices and replans; otherwise its plan stays as it is.

        Raises:
            InputError: a driver on a route is already at its goal there.
        """
        journeys, goal, onwards = self._rules.journeys, self.course.goal, None
        if isinstance(self.plan, GuidedPlan):
            if not noticed:
                self.plan = self.plan.left_as_it_is(self)
            elif journeys is not None and goal is not None:
                onwards = journeys.onwards(goal, pose)
        self.pose = pose
        self._physics.place(pose[:2])
        if onwards is not None:
            self.course = onwards
            self.plan = self._rules.plan_for(self.course, self.step)
            self.arc = self.way = 0.0
            return
        path = self.course.path
        before, self.arc = self.arc, path.arc(pose[:2])
        self.way += path.advance(before, self.arc)

    def advance(self, distance: float, turn: float) -> tuple[float, bool]:
        """Turn, drive, take a scan: one step of noisy motion.

        Returns:
            The reward; whether a wall stopped the robot.
        """
        before = self._physics.position
        collided = self._move(distance, turn)
        self.step += 1
        self.arc, progress = self.course.path.follow(before, self._physics.position, self.arc)
        self.way += progress
        self.progress += progress
        rewards = self._rules.rewards
        reward, self.done = judged(progress, self.progress, collided, *rewards)
        if self._is_at_goal():
            reward, self.done = reward + rewards[1], True
        self.scan = self._sensor.scan(self.pose)
        return reward, collided

    def _is_at_goal(self) -> bool:
        """Whether the robot is at the end of its route, if that ends the episode."""
        route, goal = self._rules.world.route, self.course.goal
        if route is None or goal is None or not self._rules.ends_at_goal:
            return False
        dx, dy = self.pose[0] - goal[0], self.pose[1] - goal[1]
        return bool(np.sqrt(dx * dx + dy * dy) <= route.tolerance)

    def _move(self, distance: float, turn: float) -> bool:
        noise = self._noise
        noise_distance, noise_turn = self._motion.standard_normal(2).tolist()
        sd_turn = noise.turn * abs(turn) + noise.drift * distance
        heading = wrapped(self.pose[2] + turn + sd_turn * noise_turn)
        driven = distance * (1 + noise.drive * noise_distance)
        collided = self._physics.drive(driven, heading)
        self.pose = (*self._physics.position, heading)
        return collided
