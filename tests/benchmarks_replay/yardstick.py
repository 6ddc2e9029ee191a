"""A small Monte-Carlo localization in plain NumPy and SciPy, to measure the package's filters by.

It shares no motion, scan or field code with the package: rot1, drive, rot2 with Nav2's alphas, all
0.2; a product over 60 beams of z_hit exp(-d²/2σ²) + z_rand/r_max, d from the nearest occupied cell.
Of the package it takes records of a log and the cells of a map as they were read.

    python tests/benchmarks_replay/yardstick.py LOG MAP.yaml REFERENCE.tum [SEEDS]
"""

import sys

import numpy as np
from scipy import ndimage

N, BEAMS, SIGMA, Z_HIT, Z_RAND, FARTHEST, ALPHA = 2000, 60, 0.2, 0.5, 0.5, 2.0, 0.2
MOVED, TURNED = 0.25, 0.2  # m, rad: between two updates


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def sample(poses, before, after, rng):
    """Poses (n, 3) moved as odometry says the robot went from ``before`` to ``after``."""
    dx, dy, turn = after[0] - before[0], after[1] - before[1], wrap(after[2] - before[2])
    drive = np.hypot(dx, dy)
    rot1 = wrap(np.arctan2(dy, dx) - before[2]) if drive >= 0.01 else 0.0
    rot2 = wrap(turn - rot1)
    r1, r2 = (min(abs(r), abs(wrap(r - np.pi))) for r in (rot1, rot2))
    n = len(poses)
    first = rot1 - rng.normal(0, np.sqrt(ALPHA * (r1**2 + drive**2)), n)
    driven = drive - rng.normal(0, np.sqrt(ALPHA * (drive**2 + r1**2 + r2**2)), n)
    second = rot2 - rng.normal(0, np.sqrt(ALPHA * (r2**2 + drive**2)), n)
    heading = poses[:, 2] + first
    x, y = poses[:, 0] + driven * np.cos(heading), poses[:, 1] + driven * np.sin(heading)
    return np.column_stack([x, y, heading + second])


def field_of(grid):
    """Distance of each cell from the nearest occupied one, m."""
    occupied = grid.occupancy >= 100 * grid.occupied_thresh
    return ndimage.distance_transform_edt(~occupied) * grid.resolution


def log_weights(poses, ranges, scanner, field, grid):
    chosen = np.linspace(0, scanner.beams - 1, min(BEAMS, scanner.beams)).round().astype(int)
    chosen = chosen[np.isfinite(ranges[chosen])]
    (ahead, aside), cosine, sine = scanner.mounting, np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + ahead * cosine - aside * sine
    y = poses[:, 1] + ahead * sine + aside * cosine
    angles = poses[:, 2, None] + np.asarray(scanner.angles)[chosen]
    seen = ranges[chosen].astype(float)
    x0, y0, yaw = grid.origin
    u = x[:, None] + seen * np.cos(angles) - x0
    v = y[:, None] + seen * np.sin(angles) - y0
    column = np.floor((np.cos(yaw) * u + np.sin(yaw) * v) / grid.resolution).astype(int)
    row = np.floor((np.cos(yaw) * v - np.sin(yaw) * u) / grid.resolution).astype(int)
    rows, columns = field.shape
    on = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    far = np.full(on.shape, FARTHEST)
    far[on] = np.minimum(field[row[on], column[on]], FARTHEST)
    hit = Z_HIT * np.exp(-(far**2) / (2 * SIGMA**2)) + Z_RAND / scanner.max_range
    return np.log(hit).sum(axis=1)


def track(log, grid, seed):
    """Estimated poses at each record of a log with a reference at its first, (n, 3)."""
    rng, field = np.random.default_rng(seed), field_of(grid)
    poses = log.reference[0] + rng.normal(0, (0.2, 0.2, 0.1), (N, 3))
    updated, found = log.odometry[0], [log.reference[0]]
    for record in range(1, len(log)):
        now = log.odometry[record]
        far = np.hypot(*(now - updated)[:2]) >= MOVED or abs(wrap(now[2] - updated[2])) >= TURNED
        if far:
            poses = sample(poses, updated, now, rng)
            logs = log_weights(poses, log.ranges[record], log.scanner, field, grid)
            weights = np.exp(logs - logs.max())
            weights /= weights.sum()
            mean = weights @ poses[:, :2]
            heading = np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
            estimate, updated = np.array([*mean, heading]), now
            poses = poses[rng.choice(N, N, p=weights)]
            found.append(estimate)
        else:
            found.append(np.full(3, np.nan))
    return np.array(found)


def errors(log, grid, seed):
    """Position errors at the records that the filter took in, m."""
    off = track(log, grid, seed) - log.reference
    distance = np.hypot(off[:, 0], off[:, 1])
    return distance[np.isfinite(distance)]


if __name__ == "__main__":
    from deqmcl_gym import GridMap, logs

    read = logs.read(sys.argv[1], reference=sys.argv[3])
    read = read.segment(int(read.referenced[0]))
    for number in range(int(sys.argv[4]) if len(sys.argv) > 4 else 3):
        off = errors(read, GridMap.load(sys.argv[2]), number)
        print(f"{np.median(off):.3f} m median, {np.quantile(off, 0.95):.3f} m 95 %")
