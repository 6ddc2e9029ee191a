"""Defaults and presets are the published ones, and docs/environment.md says so."""

import inspect
import math
import re
from dataclasses import fields
from pathlib import Path

import pytest

import deqmcl_gym
from deqmcl_gym.envs.info import RoomInfo
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import Lidar
from deqmcl_gym.world.config import Driver, Lap, MotionNoise, Robot, Start, World
from deqmcl_gym.world.presets import WORLDS
from deqmcl_gym.world.streams import Stream

PAGE = (Path(deqmcl_gym.__file__).parents[1] / "docs" / "environment.md").read_text("utf-8")
PARTS = {
    "lidar": Lidar, "robot": Robot, "noise": MotionNoise, "start": Start, "lap": Lap,
    "driver": Driver,
}  # fmt: skip

# preset: beams, field of view, range, σ; σ_dd, σ_φφ, σ_φd; start's spread in px and rad
PRESETS = {
    "paper": (1, math.pi / 2, 400, 100, 0.02, 0.02, 0.0005, 0, 0),
    "matched": (1, math.pi / 2, 400, 100, 0.02, 0.02, 0.0005, 10, 0.1),
    "sharp": (9, math.pi / 2, 400, 5, 0.02, 0.02, 0.0005, 0, 0),
    "guided": (1, math.pi / 2, 400, 100, 0.2, 0.2, 0.02, 5, 0.05),
}


def flat(world: World) -> tuple:
    lidar, noise, start = world.lidar, world.noise, world.start
    return (
        *(lidar.beams, lidar.field_of_view, lidar.max_range, lidar.sigma),
        *(noise.drive, noise.turn, noise.drift, start.sd_position, start.sd_heading),
    )


@pytest.mark.parametrize("name", WORLDS)
def test_a_preset_is_the_published_world(name):
    assert flat(RoomEnv(preset=name).world) == PRESETS[name]
    assert (RoomEnv(preset=name).world.driver is not None) == (name == "guided")
    assert f"| `{name}` |" in PAGE


def test_the_default_preset_is_paper():
    assert RoomEnv().world == WORLDS["paper"]


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
