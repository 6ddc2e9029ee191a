"""Data to train scan models on: ``python training_data.py --help``.

Robots drive routes through generated offices, many at once. Train on one range of buildings, score
in another: the sweeps' scenario ``lost`` takes place in the offices of seeds 0 to 19.
"""

import argparse
import io
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import deqmcl_gym  # noqa: F401 # registers the environments
from benchmarks.setup.names import scenario as scenario_named
from benchmarks.setup.scenario import RoomScenario
from deqmcl_gym.files import write_bytes
from deqmcl_gym.maps import GridMap
from deqmcl_gym.numerics import Floats
from deqmcl_gym.validation import InputError, integer

Arrays = dict[str, NDArray[Any]]


def recorded(
    buildings: tuple[int, int],
    steps: int,
    *,
    rooms: int = 64,
    crop: int = 64,
    seed: int = 0,
    scenario: str | None = None,
) -> Arrays:
    """Drive ``rooms`` robots along routes for ``steps`` steps, each episode in an office.

    Args:
        buildings: first seed of the offices, and the end, which is not one of them.
        steps: of each robot; episodes follow one another.
        rooms: robots at a time.
        crop: cells of the map along each side of a picture, even.
        seed: of the rooms.
        scenario: a name or a TOML file, whose world it is; None is ``Journey-v1``.

    Returns:
        Arrays over steps and rooms, by name:

        - scan: ranges in m, (T, n, B) float32; inf: nothing in range.
        - expected: exact ranges on the map, from the true pose, (T, n, B) float32; the world may
          differ from its map.
        - bearings: of the beams, rad from straight ahead, (B,).
        - max_range: of the lidar, m.
        - command: the motion before the scan, a drive in m after a turn in rad, (T, n, 2) float32;
          0 where an episode begins.
        - pose: the true one, (x m, y m, θ rad), (T, n, 3).
        - map: cells around the robot, the lowest row first, 1 solid or off the map, (T, n, crop,
          crop) uint8; the robot is in cell (crop/2, crop/2), and x points along the columns.
        - resolution: edge of a cell, m.
        - building: seed of the office, (T, n).
        - begins: whether it is the first scan of an episode, (T, n).

    Raises:
        InputError: a number is bad, or there are no such offices.
    """
    integer("--steps", steps, low=1, high=1_000_000)
    integer("--crop", crop, low=2, high=1000)
    if crop % 2:
        raise InputError(f"--crop is {crop}, but must be even: the robot is in its middle.")
    world = _world_of(scenario)
    world["floor_plan"] = {"office": {**world["floor_plan"]["office"], "seeds": list(buildings)}}
    made = gym.make_vec("deqmcl_gym/Journey-v1", num_envs=rooms, horizon=1, **world)
    envs: Any = made.unwrapped
    seen, info = envs.reset(seed=seed)
    begins, ended = np.ones(rooms, np.bool_), np.zeros(rooms, np.bool_)
    rows = []
    for _ in range(steps):
        places = [*zip(envs.floor_plans, info["truth"], strict=True)]
        rows.append(
            {
                "scan": seen["scan"],
                "expected": np.vstack([envs.lidar.ranges(m, x[:, None]) for m, x in places]),
                "command": info["command"],
                "pose": info["truth"],
                "map": np.stack([around(plan, pose, crop) for plan, pose in places]),
                "building": info["building"],
                "begins": begins,
            }
        )
        seen, _, terminated, truncated, info = envs.step(info["planned_actions"][:, 0])
        begins, ended = ended, terminated | truncated  # the next step begins the next episode
    made.close()
    arrays = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    edge = np.float64(envs.floor_plans[0].resolution)
    lidar = {"bearings": envs.lidar.bearings, "max_range": np.float64(envs.lidar.max_range)}
    return arrays | lidar | {"resolution": edge}


def _world_of(scenario: str | None) -> dict[str, Any]:
    """Arguments of the environment, among them an office without a seed.

    Raises:
        InputError: the scenario takes place elsewhere, or has what rooms cannot have together.
    """
    if scenario is None:
        return {"floor_plan": {"office": {}}}
    named = scenario_named(scenario)
    if not isinstance(named, RoomScenario) or named.office is None:
        raise InputError(
            f"the scenario {scenario!r} does not take place in generated offices: give one that "
            "does, such as lost."
        )
    world = {own.name: getattr(named.world, own.name) or "none" for own in fields(named.world)}
    for part in ("people", "glass"):
        if world[part] != "none":
            raise InputError(
                f"the scenario {scenario!r} has {part}, which many rooms at once cannot have: give "
                "one without."
            )
    options = {k: v for k, v in named.office["office"].items() if k not in ("seed", "seeds")}
    return {**world, "floor_plan": {"office": options}}


def around(plan: GridMap, pose: Floats, crop: int) -> NDArray[np.uint8]:
    """Return the cells around a pose, (crop, crop); 1 solid or off the map.

    Args:
        plan: a map whose origin has no yaw.
        pose: (x, y, …), whose cell is (crop/2, crop/2) of what is returned.
        crop: cells along each side.
    """
    half = crop // 2
    column, row = np.floor((pose[:2] - plan.origin[:2]) / plan.resolution).astype(int)
    padded = np.pad(plan.solid, half, constant_values=True)
    return padded[row : row + crop, column : column + crop].astype(np.uint8)


def main(words: list[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=recorded.__doc__.splitlines()[0])  # type: ignore[union-attr]
    add = parser.add_argument
    add("--buildings", default="1000:1064", metavar="A:B", help="seeds of the offices (1000:1064)")
    add("--steps", type=int, default=200, metavar="T", help="of each robot (200)")
    add("--rooms", type=int, default=64, metavar="N", help="robots at a time (64)")
    add("--crop", type=int, default=64, metavar="C", help="cells of a map along each side (64)")
    add("--seed", type=int, default=0, metavar="S", help="of the rooms (0)")
    add("--scenario", metavar="NAME", help="or a TOML file, whose world it is (Journey-v1)")
    add("--out", type=Path, required=True, metavar="FILE.npz")
    given = parser.parse_args(words)
    first, _, end = given.buildings.partition(":")
    if not (first.isdecimal() and end.isdecimal()):
        raise InputError(f"--buildings is {given.buildings!r}, but must be two seeds: 1000:1064.")
    data = recorded(
        (int(first), int(end)), given.steps, rooms=given.rooms, crop=given.crop, seed=given.seed,
        scenario=given.scenario,
    )  # fmt: skip
    content = io.BytesIO()
    np.savez_compressed(content, **data)  # type: ignore[arg-type]
    write_bytes(given.out, content.getvalue())
    steps, rooms = data["building"].shape
    offices = np.unique(data["building"]).size
    print(f"{given.out}: {steps * rooms:,} scans in {offices} offices.")


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"training_data: {error}")
