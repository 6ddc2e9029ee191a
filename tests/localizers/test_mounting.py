"""A robot whose lidar is not in its centre, or that moves sideways, is localized as well."""

import math

import numpy as np
import pytest
from following import robot_of
from reference import mounted

import localizers
from deqmcl_gym.logs.motion import dead_reckoned, increments_of
from deqmcl_gym.maps import GridMap, Lidar, Mount
from localizers import GaussianPrior, GaussianUniform, mean_pose
from localizers.models.nav2_scan import BeamCubes, LikelihoodField
from localizers.models.scan import LidarScan, Scan

BEAMS, SIGMA = 24, 0.02
CENTRE = (0.0, 0.0)
FEW = {"particles": 300}
METHODS = {
    "mcl": FEW, "mcl-map": FEW, "mcl-plan": FEW | {"lag": 5}, "deq-mcl": FEW | {"lag": 5},
    "deq-mcl-fresh": FEW | {"lag": 3},
    "ekf": {}, "grid": {"cell": 0.3, "headings": 36},
}  # fmt: skip
STARTS = np.array([3.0, 2.0, 0.3])
CELLS = np.pad(np.zeros((58, 88), np.int8), 1, constant_values=100)  # 9 m x 6 m
CELLS[25:35, 60:70] = CELLS[0:8, 10:16] = CELLS[50:, 35:42] = 100
HALL = GridMap(occupancy=CELLS, resolution=0.1)


def drive() -> np.ndarray:
    """Poses of a robot that turns on the spot, drives arcs, backs and strafes, (n, 3)."""
    steps = [(0.0, 0.0, 0.2)] * 16 + [(0.08, 0.0, 0.06)] * 25 + [(0.0, 0.06, 0.0)] * 15
    steps += [(-0.06, 0.0, -0.05)] * 15 + [(0.03, -0.05, -0.1)] * 15 + [(0.0, 0.0, -0.25)] * 10
    return dead_reckoned(steps, STARTS)


def error(method: str, place: tuple[float, float], noise: float, seed: int) -> tuple[float, float]:
    """Mean errors over a drive of the position of the robot's centre, m, and of its heading."""
    truth, rng = drive(), np.random.default_rng(seed)
    scans = HALL.ranges(mounted(truth, place), np.linspace(-math.pi, math.pi, BEAMS, False))
    scans = scans + rng.normal(0, SIGMA, scans.shape)
    moved = increments_of(truth)
    moved = moved * (1 + noise * rng.standard_normal(moved.shape))
    lidar = Lidar(beams=BEAMS, field_of_view=2 * math.pi, max_range=12.0, mounting=place)
    robot = robot_of(HALL, lidar, (0.1, 0.1, 0.05), sigma=0.1)
    localizer = localizers.make(method, robot, **METHODS[method])
    start = GaussianPrior(mean=tuple(truth[0]), sd_position=0.1, sd_heading=0.05)
    localizer.reset(start, moved, np.random.default_rng(seed))
    off = []
    for t, (scan, step) in enumerate(zip(scans[1:], moved, strict=True), start=1):
        belief = localizer.update(scan, step, moved[t:])
        x, y, heading = mean_pose(*belief.points())
        wrong = abs(math.remainder(heading - truth[t, 2], 2 * math.pi))
        off.append((math.hypot(x - truth[t, 0], y - truth[t, 1]), wrong))
    position, turn = np.mean(off, axis=0).tolist()
    return position, turn


@pytest.mark.parametrize(("method", "noise"), [("mcl", 0.0), *((name, 0.1) for name in METHODS)])
def test_a_lidar_anywhere_on_the_robot_localizes_it_as_well_as_one_in_its_centre(method, noise):
    # What a lidar pins down is its own place; the robot's centre is a lever away from it, at the
    # end of which stands the error of the heading. 1.2 times both, and 5 standard errors of the
    # means. Without the sideways part of the increments the error is some 0.4 m, 40 times this.
    seeds = range(3)
    central = np.array([error(method, CENTRE, noise, seed) for seed in seeds])
    for place in ((0.4, 0.0), (-0.25, -0.3)):
        off = np.array([error(method, place, noise, seed)[0] for seed in seeds])
        most = 1.2 * (central[:, 0] + math.hypot(*place) * central[:, 1])
        doubt = math.hypot(*(x.std(ddof=1) / math.sqrt(x.size) for x in (off, most)))
        assert off.mean() <= most.mean() + 5 * doubt, (place, off, most)


SCANS = {
    "rays": lambda lidar: LidarScan(floor_plan=HALL, lidar=lidar, beam=GaussianUniform(sigma=0.1)),
    "field": lambda lidar: LikelihoodField(
        floor_plan=HALL, lidar=lidar, sigma=0.2, farthest=2.0, cell=0.1),
    "field's product": lambda lidar: LikelihoodField(
        floor_plan=HALL, lidar=lidar, sigma=0.2, farthest=2.0, cell=0.1, product=True),
    "AMCL's beams": lambda lidar: BeamCubes(floor_plan=HALL, lidar=lidar),
}  # fmt: skip
ASKEW = (Mount(x=0.3, y=0.1, heading=0.4), Mount(x=-0.3, heading=2.9, upside_down=True))


@pytest.mark.parametrize("model", SCANS)
def test_what_two_mounts_see_is_the_product_or_the_sum_of_what_each_sees(model):
    """Two lidars' beams weigh as those of each, from a robot that has it alone, turned to it."""
    fan = {"field_of_view": math.pi, "max_range": 12.0}
    both = Lidar(beams=12, mounts=ASKEW, **fan)
    poses = drive()[::8]
    scan = np.float64(both.ranges(HALL, poses.T)[3]) + 0.013  # no ties at the walls
    states = np.ascontiguousarray(poses.T, dtype=np.float32)
    found = SCANS[model](both).log_likelihood(states, Scan.of(scan, 12.0))
    parts = []
    for mount, rows in zip(ASKEW, both.rows, strict=True):
        # the same rays, from a plain lidar on a robot that stands where the scanner does
        seats = mounted(poses, (mount.x, mount.y))
        seats[:, 2] += mount.heading
        plain = Lidar(beams=6, **fan)
        seen = scan[rows][::-1] if mount.upside_down else scan[rows]
        one = np.ascontiguousarray(seats.T, dtype=np.float32)
        parts.append(SCANS[model](plain).log_likelihood(one, Scan.of(np.array(seen), 12.0)))
    if model in ("rays", "field's product"):
        expected = parts[0] + parts[1]
    else:
        expected = np.log(np.exp(parts[0]) + np.exp(parts[1]) - 1.0)  # w = 1 + Σ q³
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3)
    assert int(found.argmax()) == 3
