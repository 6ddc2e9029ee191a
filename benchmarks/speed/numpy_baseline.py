"""MCL in plain NumPy: what we compare with, and the models that peers are given.

Float32, one logarithm per scan, systematic resampling; whole-array operations in blocks that fit
the cache. Rays are cast against every wall as a segment, or, where the map is made of axis-aligned
rectangles, by the slab method that the kernels use.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.maps.polygons import as_box
from deqmcl_gym.numerics.types import Floats, Indices, Reals, Singles
from deqmcl_gym.validation import InputError
from localizers import GaussianUniform, OdometryMotion, Prior, RobotModel
from localizers.models.scan import OUTSIDE

RAYS_PER_BLOCK = 16_384  # 64 KiB per temporary array; the fastest of 1,024 to 65,536


Caster = Callable[[Singles, Singles], Singles]  # poses (3, n), bearings (B,) -> ranges (B, n)


def segments(floor_plan: PolygonMap) -> Caster:
    """Return a caster that tries every wall as a segment."""
    return partial(_cast_segments, walls=floor_plan.walls.astype(np.float32))


def slabs(floor_plan: PolygonMap) -> Caster:
    """Return a caster that knows rectangles; about as fast as NumPy goes."""
    return partial(_cast_slabs, boxes=boxes_of(floor_plan))


def boxes_of(floor_plan: PolygonMap) -> Singles:
    """Return the map's rectangles, the outer one first: (x_low, y_low, x_high, y_high), (k, 4)."""
    boxes = [as_box(polygon) for polygon in (floor_plan.outer, *floor_plan.obstacles)]
    if None in boxes:
        raise InputError("the NumPy baseline knows axis-aligned rectangles only: give such a map.")
    return np.array(boxes, dtype=np.float32)


def ranges(poses: Singles, bearings: Singles, cast: Caster) -> Singles:
    """Distance along each beam to the nearest wall, inf where there is none, (B, n) px.

    Args:
        poses: rows x px, y px, θ rad, (3, n).
        bearings: against the heading, (B,) rad.
        cast: ``segments`` or ``slabs`` of a floor plan.
    """
    out = np.empty((bearings.size, poses.shape[1]), np.float32)
    for block in _blocks(poses.shape[1], bearings.size):
        out[:, block] = cast(poses[:, block], bearings)
    return out


def systematic(weights: Floats, rng: np.random.Generator) -> Indices:
    """One uniform offset for n equidistant pointers (Kitagawa 1996), (n,)."""
    n = weights.size
    reached = np.cumsum(weights)
    slots = np.ceil(reached * (n / reached[-1]) - rng.random()).astype(np.intp)
    return np.repeat(np.arange(n), np.diff(slots, prepend=0))


@dataclass(frozen=True)
class NumpyModels:
    """The motion and scan models of a robot.

    Attributes:
        robot: with an ``OdometryMotion`` and a ``GaussianUniform``.
        caster: ``segments`` or ``slabs``.
    """

    robot: RobotModel
    caster: Callable[[PolygonMap], Caster] = segments

    def moved(self, states: Singles, action: Reals, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose (3, n)."""
        motion = self.robot.motion
        assert isinstance(motion, OdometryMotion)
        distance, turn = float(action[0]), float(action[1])
        sd_turn = motion.turn * abs(turn) + motion.drift * abs(distance)
        noise = rng.standard_normal((2, states.shape[1]), dtype=np.float32)
        drive = distance + motion.drive * abs(distance) * noise[0]
        heading = states[2] + (turn + sd_turn * noise[1])
        heading -= 2 * math.pi * np.rint(heading / (2 * math.pi))
        out = np.empty_like(states)
        out[0] = states[0] + drive * np.cos(heading)
        out[1] = states[1] + drive * np.sin(heading)
        out[2] = heading
        return out

    def log_likelihood(self, states: Singles, scan: Reals) -> Floats:
        """Σ_b log p(o_b | ô_b) of a scan (B,) px at each pose (3, n), (n,)."""
        beam = self.robot.scan
        assert isinstance(beam, GaussianUniform)
        peak = (1 - beam.uniform) / (beam.sigma * math.sqrt(2 * math.pi))
        floor = beam.uniform / self.robot.lidar.max_range
        measured = np.asarray(scan, dtype=np.float32)[:, None]
        out = np.empty(states.shape[1])
        for block in _blocks(states.shape[1], measured.size):
            z = (measured - self._cast(states[:, block], self._bearings)) / beam.sigma
            density = peak * np.exp(-0.5 * z * z) + floor
            out[block] = np.log(density.prod(axis=0, dtype=np.float64))
        left, low, right, high = self.robot.floor_plan.bounds
        inside = (states[0] > left) & (states[0] < right) & (states[1] > low) & (states[1] < high)
        return np.where(inside, out, OUTSIDE)

    @cached_property
    def _bearings(self) -> Singles:
        return self.robot.lidar.bearings.astype(np.float32)

    @cached_property
    def _cast(self) -> Caster:
        floor_plan = self.robot.floor_plan
        assert isinstance(floor_plan, PolygonMap), "the baseline knows polygons only"
        return self.caster(floor_plan)


@dataclass(frozen=True)
class Cloud:
    """A ``Belief`` about the present: poses (n, 3) and weights (n,)."""

    poses: Reals
    weights: Floats

    def points(self, offset: int = 0) -> tuple[Reals, Floats] | None:
        """Return poses and weights; None for another offset than 0."""
        return None if offset else (self.poses.copy(), self.weights.copy())


class NumpyMCL:
    """MCL as ``localizers.make("mcl", robot, particles=…)``, a ``Localizer``."""

    def __init__(
        self,
        robot: RobotModel,
        *,
        particles: int,
        caster: Callable[[PolygonMap], Caster] = segments,
    ) -> None:
        """Make MCL for a robot."""
        self._models = NumpyModels(robot, caster)
        self._particles = particles

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Cloud:
        """Start anew."""
        del plan
        self._rng = rng
        self._states = np.array(prior.sample(self._particles, rng).T, np.float32, order="C")
        self._weights = np.full(self._particles, 1 / self._particles)
        return Cloud(self._states.T, self._weights)

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Cloud:
        """Go one step on."""
        del plan
        survivors = self._states[:, systematic(self._weights, self._rng)]
        self._states = self._models.moved(survivors, action, self._rng)
        log_weights = self._models.log_likelihood(self._states, ranges)
        weights = np.exp(log_weights - log_weights.max())
        self._weights = weights / weights.sum()
        return Cloud(self._states.T, self._weights)


def _cast_segments(poses: Singles, bearings: Singles, *, walls: Singles) -> Singles:
    """``ranges`` of one block: where each ray and each wall cross."""
    x, y, _ = poses
    dx, dy = _directions(poses, bearings)
    nearest = np.full((bearings.size, x.size), np.inf, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        for x0, y0, x1, y1 in walls:
            ex, ey = x1 - x0, y1 - y0
            rx, ry = x0 - x, y0 - y
            denominator = dx * ey - dy * ex
            t = (rx * ey - ry * ex) / denominator
            u = (rx * dy - ry * dx) / denominator
            t[(t < 0) | (u < 0) | (u > 1)] = np.inf
            np.fmin(nearest, t, out=nearest)  # parallel to the wall: NaN
    return nearest


def _cast_slabs(poses: Singles, bearings: Singles, *, boxes: Singles) -> Singles:
    """``ranges`` of one block, by the slab method (Kay & Kajiya 1986)."""
    x, y, _ = poses
    dx, dy = _directions(poses, bearings)
    nearest = np.full((bearings.size, x.size), np.inf, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        per_dx, per_dy = 1 / dx, 1 / dy
        for x_low, y_low, x_high, y_high in boxes:
            to_left, to_right = (x_low - x) * per_dx, (x_high - x) * per_dx
            to_low, to_high = (y_low - y) * per_dy, (y_high - y) * per_dy
            enter = np.maximum(np.minimum(to_left, to_right), np.minimum(to_low, to_high))
            leave = np.minimum(np.maximum(to_left, to_right), np.maximum(to_low, to_high))
            t = np.where(enter >= 0, enter, leave)
            t[(leave < enter) | (t < 0)] = np.inf
            np.minimum(nearest, t, out=nearest)
    return nearest


def _directions(poses: Singles, bearings: Singles) -> tuple[Singles, Singles]:
    """Unit vectors along each beam, (B, n) each."""
    sine, cosine = np.sin(poses[2]), np.cos(poses[2])
    beam_sine, beam_cosine = np.sin(bearings)[:, None], np.cos(bearings)[:, None]
    dx = cosine * beam_cosine - sine * beam_sine
    return dx, sine * beam_cosine + cosine * beam_sine


def _blocks(n: int, beams: int) -> list[slice]:
    size = max(1, RAYS_PER_BLOCK // beams)
    return [slice(start, start + size) for start in range(0, n, size)]
