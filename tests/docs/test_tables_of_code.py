"""The tables of ids and arguments name all that the code has."""

import inspect
import re
from dataclasses import fields

import gymnasium as gym
import pytest

from deqmcl_gym import Office
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import Mount
from deqmcl_gym.world import config
from deqmcl_gym.world.config import WORLDS
from docs import tables_of_code as tables


def rows(table):
    """The cells of a table's rows, by the name in the first."""
    return {cells[0].strip("`"): cells[1:] for cells in table[1]}


def test_every_id_has_a_row_with_its_steps():
    found = rows(tables.ids())
    ours = {name for name in gym.registry if name.startswith("deqmcl_gym/")}
    assert {f"deqmcl_gym/{name}" for name in found} == ours
    assert found["Room-v0"][-2] == "408"
    assert found["Localize-v0"][-2] == "300"
    assert "`lidar.beams=9`" in found["Sharp-v0"][1]


def test_the_arguments_of_a_room_are_those_of_its_signature_and_of_all_parts():
    parts = {name: getattr(WORLDS["paper"], name) for name in ("lidar", "robot", "noise")}
    parts |= {name: getattr(WORLDS["paper"], name) for name in ("start", "lap")}
    parts |= {name: kind() for name, kind in config._OPTIONAL.items()}
    keys = {f"{name}.{own.name}" for name, part in parts.items() for own in fields(part)}
    given = set(inspect.signature(RoomEnv).parameters) - {"unknown"}
    asked = given - {"lidar", "robot", "noise", "start", "lap"}
    found = rows(tables.arguments("Room-v0"))
    assert set(found) == asked | keys
    assert all(said for _, said in found.values())
    assert found["lidar.field_of_view"][0] == "`π/2`"
    assert found["lidar.max_range"][0] == "`400.0` px"


@pytest.mark.parametrize("name", ["Localize-v0", "Track-v0"])
def test_the_arguments_of_a_task_are_those_of_the_classes_that_it_is_made_of(name):
    found = rows(tables.arguments(name))
    assert {"localizer", "floor_plan", "max_steps", "particles", "render_mode"} <= set(found)
    gym.make(f"deqmcl_gym/{name}", localizer={"name": "mcl-map", "particles": 10},
             **dict.fromkeys(("floor_plan", "lidar", "robot", "noise", "cell")))  # fmt: skip


def test_the_arguments_of_a_log_are_all_there_and_so_are_the_keys_of_a_part():
    given = set(inspect.signature(LogEnv).parameters) - {"others"}
    assert set(rows(tables.arguments("Log-v0"))) == given
    for part in (Office, Mount):
        found = rows(tables.arguments(part.__name__))
        assert set(found) == {own.name for own in fields(part)}
        assert all(re.search(r"\w", said) for _, said in found.values())
