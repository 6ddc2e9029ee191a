"""Reality: what is there in an episode, where it differs from the map that the robot is given."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.maps.altered import altered
from deqmcl_gym.maps.map import Caster
from deqmcl_gym.numerics import Floats, Point, Pose
from deqmcl_gym.world.config import World
from deqmcl_gym.world.course import Course
from deqmcl_gym.world.differences import WallChanges, Way
from deqmcl_gym.world.driver import GuidedPlan, Plan, points_of
from deqmcl_gym.world.people import AmongPeople, Crowd
from deqmcl_gym.world.rules import RoomRules
from deqmcl_gym.world.sensor import Stream, ThroughGlass, episode_stream

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing, View

Streams = Callable[[Stream], np.random.Generator]  # of an episode, each from its beginning

_CLOSEST = 0.05  # px: walls nearer than this to each other are one to a beam


@dataclass(frozen=True, eq=False)
class Reality:
    """A world as it is in one episode."""

    mapped: Map
    world: World  # the world with what is there as its floor plan
    keeps_route: bool  # whether nothing is on the way planned on the map
    glass: Floats  # walls that are glass, (k, 4, 2)
    behind_glass: Map  # what is there without them

    @classmethod
    def drawn(cls, world: World, course: Course, plan: Plan, streams: Streams) -> "Reality":
        """Draw what differs from the map in an episode, on which its course and plan are made."""
        ground, clutter, walls = world.floor_plan, world.clutter, world.changed_walls
        changes, things = WallChanges(np.empty((0, 4, 2)), []), list[Floats]()
        kept = [part.keep_route for part in (clutter, walls) if part is not None]
        if walls is not None:
            way = _way(world, course, plan, walls.keep_route)
            changes = walls.drawn(ground, way, streams(Stream.CHANGED_WALLS))
        if clutter is not None:
            way = _way(world, course, plan, clutter.keep_route)
            things = clutter.drawn(ground, way, streams(Stream.CLUTTER))
        filled = [*changes.filled, *things]
        there = behind = altered(ground, changes.cleared, filled)
        glass = np.empty((0, 4, 2))
        if world.glass is not None:
            glass = world.glass.drawn(ground, streams(Stream.GLASS))
            behind = altered(ground, np.vstack([changes.cleared, glass]), filled)
        real = world if there is ground else replace(world, floor_plan=there)
        return cls(ground, real, all(kept), glass, behind)

    def crowd(self, robot: Point, streams: Streams) -> Crowd | None:
        """Return the people, if there are any, around a robot at its start."""
        world = self.world
        if world.people is None:
            return None
        rng = streams(Stream.PEOPLE)
        return Crowd(world.people, world.floor_plan, robot, world.body, rng)

    def caster(self, crowd: Crowd | None, streams: Streams) -> Caster:
        """Return what beams meet, for poses relative to the floor plan's datum."""
        ground, glass = self.world.floor_plan, self.world.glass
        caster = ground.local.caster
        if glass is not None:
            others, closest = self.behind_glass.local.caster, _CLOSEST * self.world.pixel
            caster = ThroughGlass(caster, others, glass, closest, streams(Stream.THROUGH_GLASS))
        return caster if crowd is None else AmongPeople(caster, crowd, ground.datum)

    def picture(self, view: "View", crowd: Crowd | None) -> "Drawing":
        """Draw what is there: solid, glass in blue; the map in outline; people as discs."""
        from deqmcl_gym.world.drawing import GLASS, MAPPED, PERSON, Drawing

        drawing = Drawing(replace(view, floor_plan=self.world.floor_plan))
        if self.world.floor_plan is not self.mapped:
            drawing.segments(self.mapped.walls, MAPPED)
        drawing.solids(self.glass, GLASS)
        return drawing if crowd is None else drawing.discs(crowd.places, crowd.radius, PERSON)


@dataclass(frozen=True, eq=False)
class Beginning:
    """What is drawn for an episode before its first step."""

    there: RoomRules  # the rules, in the world as it is in this episode
    course: Course  # the path, and the actions planned for it
    plan: Plan
    reality: Reality
    start: Pose  # the true pose (x, y, θ)

    @classmethod
    def drawn(cls, rules: RoomRules, seed: int, number: int) -> "Beginning":
        """Draw the ``number``-th episode after seeding."""
        course, plan = rules.begun(seed, number)
        streams = partial(episode_stream, seed, number)
        reality = Reality.drawn(rules.world, course, plan, streams)
        world = reality.world
        if world is rules.world:
            return cls(rules, course, plan, reality, rules.start(course, seed, number))
        there = replace(rules, world=world)
        start = there.start(course, seed, number)
        if isinstance(plan, GuidedPlan):  # he has planned on the map, sees what is there
            journeys, goal = there.journeys, course.goal
            if reality.keeps_route or journeys is None or goal is None:
                plan = replace(plan, world=world)
            else:
                course = journeys.onwards(goal, start)
                plan = there.plan_for(course)
        return cls(there, course, plan, reality, start)

    @property
    def arc(self) -> float:
        """Arc length at which it begins."""
        course = self.course
        return course.path.follow(course.start[:2], self.start[:2], course.arc)[0]


def _way(world: World, course: Course, plan: Plan, whole: bool) -> Way:
    """Return the way planned on the map, with that of a driver without noise, or its ends."""
    corners = course.path.outline
    if not whole:
        ends = [course.start[:2]] if course.goal is None else [course.start[:2], course.goal]
        ways = [np.array([end, end]) for end in ends]
    else:
        ways = [corners, np.vstack([course.start[:2], points_of(course.start, plan.actions)])]
    found = [Way.along(way, world.body, world.floor_plan) for way in ways]
    return Way(np.vstack([way.points for way in found]), found[0].margin)
