"""What kernels of every file say in small cases, as digests: run here or as a process."""

import hashlib
import json
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.numerics import arrays, elementary

# one wall of each kind that a caster knows: room, boxes, upright, level, oblique
WALLS = (
    [(0, 0), (90, 0), (90, 70), (0, 70)],
    [
        [(20, 20), (30, 20), (30, 30), (20, 30)],
        [(50, 20), (60, 20), (60, 30), (50, 30)],
        [(20, 50), (40, 50), (40, 60), (30, 55), (20, 60)],
    ],
)


def cases() -> Iterator[tuple[str, np.ndarray]]:
    rng = np.random.default_rng(0)
    for name in ("sin", "cos", "wrapped", "exp", "log", "normal_cdf"):
        yield f"arrays.{name}", getattr(arrays, name)(-8 * rng.random(20))
    yield "arrays.arctan2", arrays.arctan2(*rng.normal(size=(2, 20)))
    singles, logs = rng.normal(0, 5, 20).astype(np.float32), np.empty(20)
    sines, cosines = np.empty_like(singles), np.empty_like(singles)
    elementary.sincos32(singles, sines, cosines)
    elementary.logs64(rng.random(20), logs)
    yield "elementary", np.concatenate([sines, cosines, logs])

    plan = PolygonMap(*WALLS)
    poses = np.float32([*rng.uniform((-5, -5), (95, 75), (9, 2)).T, rng.uniform(-3, 3, 9)])
    bearings = np.float32([-0.5, 0.0, 0.5])
    for some in (poses, np.ascontiguousarray(poses[:, :3])):  # many poses, and a handful
        out = np.empty((3, some.shape[1]), np.float32)
        plan.cast(some, bearings, out)
        yield f"ranges, {some.shape[1]}", out
    moves = np.float32(rng.uniform(0, 1, (3, 3, 9))) * np.float32([[20], [5], [1]])
    ends, hits = plan.rolled_out(poses, moves, 2.0, kept=3)
    collides = [plan.collides(a.T, b.T, 2.0) for a, b in pairwise([poses, *ends])]
    for name, said in {
        "ends": ends, "hits": hits, "collides": np.array(collides),
        "along": plan.collisions_along(poses, np.cumsum(np.float32([[3, 1]] * 9), axis=0), 2.0),
        "free": plan.free(poses.T, 2.0), "distance": plan.distance(poses.T),
    }.items():  # fmt: skip
        yield name, said

    lidar, noise = {"beams": 3, "sigma": 5.0}, {"drive": 0.3}
    one = RoomEnv(preset="guided", lidar=lidar, horizon=5)
    many = RoomVectorEnv(num_envs=3, lidar=lidar, noise=noise, start={"pose": (335, 50, 0.0)})
    for name, env in {"one room": one, "many rooms": many}.items():
        scan, info = env.reset(seed=1)
        seen = [scan, info["truth"]]
        for _ in range(4):
            ahead = np.zeros_like(info["command"]) + np.float32([8.0, 0.1])  # into a wall, for many
            scan, reward, *_, info = env.step(ahead)
            seen += [scan, np.array(reward), info["truth"], info["planned_actions"]]
        yield name, np.concatenate([np.ravel(values) for values in seen])


def digests() -> dict[str, str]:
    return {name: hashlib.sha256(np.ascontiguousarray(a)).hexdigest() for name, a in cases()}


if __name__ == "__main__":
    print(json.dumps(digests()))
