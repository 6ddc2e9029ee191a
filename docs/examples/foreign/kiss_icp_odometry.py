"""
A trajectory of another library: KISS-ICP
=========================================

`KISS-ICP <https://github.com/PRBonn/kiss-icp>`_ (Vizzo et al. 2023), odometry from scans alone,
registers the scans of a log, one after the other. It knows no map and no odometry. Its trajectory
begins at the first pose of the reference; ``deqmcl score`` scores it:
``python docs/examples/foreign/kiss_icp_odometry.py lap.csv.gz lap.tum kiss.tum``.
"""

import sys

import numpy as np

from deqmcl_gym import logs
from deqmcl_gym.logs.motion import composed
from deqmcl_gym.validation import InputError

try:
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP
except ModuleNotFoundError:
    raise InputError("kiss_icp_odometry.py needs KISS-ICP: run pip install kiss-icp.") from None

CELLS = 100  # of its map in the largest range: its default


def points_of(log: logs.Log, record: int) -> np.ndarray:
    """The ends of the beams that have a return, in the frame of the base, (n, 3), z = 0."""
    rays, seen = log.scanner.rays(np.zeros(3)), log.ranges[record].astype(float)
    (x, y, bearings), far = rays[np.isfinite(seen)].T, seen[np.isfinite(seen)]
    ends = x + far * np.cos(bearings), y + far * np.sin(bearings)
    return np.column_stack([*ends, np.zeros(len(far))])


def odometry(log: logs.Log) -> np.ndarray:
    """Poses (x, y, θ) of all records in the frame of the first, (n, 3)."""
    config = KISSConfig()
    config.data.deskew = False
    config.data.min_range, config.data.max_range = 0.0, float(log.scanner.max_range)
    config.mapping.voxel_size = config.data.max_range / CELLS
    matcher, poses = KissICP(config), []
    for record in range(len(log)):
        points = points_of(log, record)
        matcher.register_frame(points, np.zeros(len(points)))
        pose = matcher.last_pose
        poses.append([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])
    return np.array(poses)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit("usage: kiss_icp_odometry.py LOG REFERENCE.tum OUT.tum")
    log = logs.read(sys.argv[1], reference=sys.argv[2])
    first = int(log.referenced[0])
    log = log.of_records(np.arange(first, len(log)))
    poses = composed(np.tile(log.reference[0], (len(log), 1)), odometry(log))
    logs.Trajectory(log.times, poses).write(sys.argv[3])
