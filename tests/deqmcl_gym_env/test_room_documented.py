"""docs/environment.md names every argument, default, preset, key of info and stream."""

import inspect
import math
import re
from dataclasses import fields
from pathlib import Path

import pytest

import deqmcl_gym
from deqmcl_gym.envs.room import RoomEnv, RoomInfo
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import Lidar
from deqmcl_gym.world.config import WORLDS, Driver, Lap, MotionNoise, Robot, Route, Start
from deqmcl_gym.world.sensor import Stream

PAGE = (Path(deqmcl_gym.__file__).parents[1] / "docs" / "environment.md").read_text("utf-8")
PARTS = {
    "lidar": Lidar, "robot": Robot, "noise": MotionNoise, "start": Start, "lap": Lap,
    "driver": Driver,
    "route": Route,
}  # fmt: skip


def test_every_preset_is_documented_and_only_one_has_a_driver():
    for name in WORLDS:
        assert f"| `{name}` |" in PAGE
        assert (RoomEnv(preset=name).world.driver is not None) == (name == "guided")


def documented_default(argument: str) -> str:
    """The second cell of the argument's row in the page's table."""
    row = re.search(rf"^\| `{re.escape(argument)}` \| ([^|]*) \|", PAGE, re.MULTILINE)
    assert row, f"{argument} has no row"
    return row.group(1).strip("`")


@pytest.mark.parametrize(
    ("argument", "default"),
    [(f"{part}.{own.name}", own.default) for part, cls in PARTS.items() for own in fields(cls)],
)
def test_every_key_of_a_part_is_documented_with_its_default(argument, default):
    text = documented_default(argument)
    fraction = re.fullmatch(r"π/(\d+)", text)
    assert (math.pi / int(fraction[1]) if fraction else text) == (
        default if fraction else repr(default)
    )


def test_every_argument_is_documented_with_its_default():
    for name, argument in inspect.signature(RoomEnv).parameters.items():
        if argument.kind is argument.VAR_KEYWORD:
            continue
        if name == "floor_plan":
            assert documented_default(name) == "the room above"
        elif name not in PARTS:
            assert documented_default(name).replace('"', "'") == repr(argument.default)


def test_every_key_of_info_and_every_stream_is_documented():
    for key in RoomInfo.__annotations__:
        assert f"| `{key}` | " in PAGE
    for stream in Stream:
        assert f"\n| {stream.value} | " in PAGE


def test_every_further_argument_of_the_vector_env_is_documented():
    further = set(inspect.signature(RoomVectorEnv).parameters) - {"room", "render_mode"}
    assert all(documented_default(name) for name in further)
