"""MCL in plain NumPy: what we compare with, and the models that peers are given.

Float32, one logarithm per scan, systematic resampling; whole-array operations in blocks that fit
the cache. Rays are cast in the plain form of ``tests/reference.py``, every ray against every wall,
or, where the map is made of axis-aligned rectangles, by the slab method that the kernels use.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.maps.polygons import as_box
from deqmcl_gym.numerics.types import Floats, Indices, Reals, Singles
from localizers import GaussianUniform, OdometryMotion, Prior, RobotModel
from localizers.models.scan import outside

RAYS_PER_BLOCK = 16_384  # 64 KiB per temporary array; the fastest of 1,024 to 65,536

Cloud = tuple[Reals, Floats]  # poses (n, 3) and weights (n,)
Caster = Callable[[Singles, Singles], Singles]  # poses (3, n), bearings (B,) -> ranges (B, n)
CasterMaker = Callable[[PolygonMap], Caster]


def segments(floor_plan: PolygonMap) -> Caster:
    """Return a caster that tries every wall as a segment, as ``tests/reference.py`` does."""
    return partial(_cast, partial(_nearest_segment, floor_plan.walls.astype(np.float32)))


def slabs(floor_plan: PolygonMap) -> Caster:
    """Return a caster for a map of axis-aligned rectangles; about as fast as NumPy goes."""
    boxes = [as_box(polygon) for polygon in (floor_plan.outer, *floor_plan.obstacles)]
    return partial(_cast, partial(_nearest_slab, np.array(boxes, dtype=np.float32)))


def systematic(weights: Floats, rng: np.random.Generator) -> Indices:
    """One uniform offset for n equidistant pointers (Kitagawa 1996), (n,)."""
    n = weights.size
    reached = np.cumsum(weights)
    slots = np.ceil(reached * (n / reached[-1]) - rng.random()).astype(np.intp)
    return np.repeat(np.arange(n), np.diff(slots, prepend=0))


class NumpyModels:
    """The motion and scan models of a robot in the paper's room."""

    def __init__(self, robot: RobotModel, caster: CasterMaker = segments) -> None:
        """Take over the ``OdometryMotion`` and the ``GaussianUniform`` of a robot."""
        assert isinstance(robot.motion, OdometryMotion)
        assert isinstance(robot.scan, GaussianUniform)
        assert isinstance(robot.floor_plan, PolygonMap)
        self.robot, self._motion, self._beam = robot, robot.motion, robot.scan
        self._cast = caster(robot.floor_plan)
        self._bearings = robot.lidar.bearings.astype(np.float32)

    def moved(self, states: Singles, action: Reals, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose (3, n)."""
        motion = self._motion
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
        beam = self._beam
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
        return np.where(inside, out, measured.size * outside(floor))


def mcl(
    robot: RobotModel,
    particles: int,
    prior: Prior,
    rng: np.random.Generator,
    caster: CasterMaker = segments,
) -> Callable[..., Cloud]:
    """Return ``update`` of MCL, as that of ``localizers.make("mcl", robot, particles=…)``."""
    models = NumpyModels(robot, caster)
    states = np.array(prior.sample(particles, rng).T, np.float32, order="C")
    weights = np.full(particles, 1 / particles)

    def update(scan: Reals, action: Reals, *_: object) -> Cloud:
        nonlocal states, weights
        states = models.moved(states[:, systematic(weights, rng)], action, rng)
        log_weights = models.log_likelihood(states, scan)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        return states.T, weights

    return update


def _cast(nearest: Callable[..., None], poses: Singles, bearings: Singles) -> Singles:
    """Distance along each beam to the nearest wall, inf where there is none, (B, n) px."""
    out = np.empty((bearings.size, poses.shape[1]), np.float32)
    beam_sine, beam_cosine = np.sin(bearings)[:, None], np.cos(bearings)[:, None]
    for block in _blocks(poses.shape[1], bearings.size):
        x, y, heading = poses[:, block]
        sine, cosine = np.sin(heading), np.cos(heading)
        dx = cosine * beam_cosine - sine * beam_sine
        dy = sine * beam_cosine + cosine * beam_sine
        found = np.full(dx.shape, np.inf, np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            nearest(x, y, dx, dy, found)
        out[:, block] = found
    return out


def _nearest_segment(
    walls: Singles, x: Singles, y: Singles, dx: Singles, dy: Singles, out: Singles
) -> None:
    """Where each ray and each wall cross."""
    for x0, y0, x1, y1 in walls:
        ex, ey = x1 - x0, y1 - y0
        rx, ry = x0 - x, y0 - y
        denominator = dx * ey - dy * ex
        t = (rx * ey - ry * ex) / denominator
        u = (rx * dy - ry * dx) / denominator
        t[(t < 0) | (u < 0) | (u > 1)] = np.inf
        np.fmin(out, t, out=out)  # parallel to the wall: NaN


def _nearest_slab(
    boxes: Singles, x: Singles, y: Singles, dx: Singles, dy: Singles, out: Singles
) -> None:
    """The slab method (Kay & Kajiya 1986), from inside or outside of a box."""
    per_dx, per_dy = 1 / dx, 1 / dy
    for x_low, y_low, x_high, y_high in boxes:
        to_left, to_right = (x_low - x) * per_dx, (x_high - x) * per_dx
        to_low, to_high = (y_low - y) * per_dy, (y_high - y) * per_dy
        enter = np.maximum(np.minimum(to_left, to_right), np.minimum(to_low, to_high))
        leave = np.minimum(np.maximum(to_left, to_right), np.maximum(to_low, to_high))
        t = np.where(enter >= 0, enter, leave)
        t[(leave < enter) | (t < 0)] = np.inf
        np.minimum(out, t, out=out)


def _blocks(n: int, beams: int) -> list[slice]:
    size = max(1, RAYS_PER_BLOCK // beams)
    return [slice(start, start + size) for start in range(0, n, size)]
