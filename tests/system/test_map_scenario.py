"""A scenario with a map, found beside its file, and a route; the office of ``deqmcl new map``."""

import numpy as np
import pytest
from deqmcl_command import exit_code, files

from benchmarks.setup.names import scenario, scenario_digest
from deqmcl_gym import GridMap, Office

ROUTE = """[env.lap]
waypoints = [[1.0, 1.0], [3.4, 1.0], [3.4, 2.4], [1.0, 2.4]]
[env.lidar]
beams = 16
field_of_view = 6.283
sigma = 0.1
[assumed.scan]
sigma = 0.1
"""
WAYS = {
    "[env]\nfloor_plan = 'maps/hall.yaml'\n": True,
    "[env.floor_plan]\nfile = 'maps/hall.yaml'\nunknown = 'free'\n": False,
}


@pytest.fixture
def hall(tmp_path, monkeypatch):
    cells = np.pad(np.zeros((66, 86), np.int8), 1, constant_values=100)
    cells[28:40, 28:60] = 100
    cells[60:, 80:] = -1
    (tmp_path / "maps").mkdir()
    (tmp_path / "elsewhere").mkdir()
    GridMap(occupancy=cells, resolution=0.05).save(tmp_path / "maps" / "hall.yaml")
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path


@pytest.mark.parametrize("way", WAYS)
def test_its_path_is_seen_from_the_scenarios_folder(hall, way):
    (hall / "hall.toml").write_text(way + ROUTE)
    floor_plan = scenario("../hall.toml").world.floor_plan
    assert isinstance(floor_plan, GridMap)
    assert floor_plan.solid[-3, -3] == WAYS[way]


def test_an_edit_of_the_map_is_another_scenario(hall):
    (hall / "hall.toml").write_text(next(iter(WAYS)) + ROUTE)
    before = scenario_digest("../hall.toml")
    assert scenario_digest("../hall.toml") == before
    yaml = hall / "maps" / "hall.yaml"
    yaml.write_text(yaml.read_text().replace("0.05", "0.051"))
    assert scenario_digest("../hall.toml") != before


def test_a_new_map_is_the_office(tmp_path, capsys, refusal):
    out = tmp_path / "new"
    size = ["--wings", "2", "--corridors", "1", "--corridor", "1.5", "--door", "1.1"]
    given = ["new", "map", "--seed", "5", *size, "--symmetric", "--out", out]
    assert exit_code(*given) == 0
    assert "office.yaml" in capsys.readouterr().out
    office = Office(seed=5, wings=2, corridors=1, corridor=1.5, door=1.1, symmetric=True)
    assert (GridMap.load(out / "office.yaml").solid == office.grid.solid).all()
    written = files(out)
    assert [*written] == ["office.pgm", "office.yaml"]
    refusal(given, "is not empty")
    assert files(out) == written
