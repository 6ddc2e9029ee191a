"""Scenarios of one's own: those of docs/sweeps.md, and one with a map beside its file."""

import json
import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
from deqmcl_command import exit_code, files
from sweep_command import without_report

from benchmarks.setup.names import scenario, scenario_digest
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials.stage import Stage
from deqmcl_gym import GridMap, Office

PAGE = Path(__file__).parents[2] / "docs" / "sweeps.md"
BLOCKS = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
NOISY, _, ROOM, OFFICE, IN_A_ROOM, PLACES, _, AS_WORLD = BLOCKS  # displaced: test_basin.py
REPORTS = PAGE.with_name("reports.md")
FEW = ("--scenario", "room.toml", "--particles", "20", "--lag", "3")


@pytest.fixture
def room(here):
    assert len(ROOM.splitlines()) == 15
    path = here / "room.toml"
    path.write_text(ROOM)
    return path


@pytest.mark.parametrize("page", [PAGE, REPORTS], ids=lambda page: page.stem)
def test_the_commands_of_a_page_work_as_they_stand_one_after_the_other(room, capsys, page):
    Path("noisy.toml").write_text(NOISY)
    few = ["--set", "params.particles=10", "--set", "filter_seeds=1", "--jobs", "1"]
    commands = "".join(re.findall(r"```sh\n(.*?)```", page.read_text(), re.DOTALL))
    with without_report() as patched:
        patched.setattr("benchmarks.report.page.require_report", lambda: None)
        for command in commands.splitlines():
            short = command.replace(" --set params.particles=300", "")
            fewer = """worlds 20 --set 'localizers=["mcl", "dead-reckoning"]'"""
            words = shlex.split(short.replace("worlds 40", fewer))
            if words[0] != "deqmcl":
                subprocess.run(command, shell=True, check=True)
                continue
            if words[1] in ("sweep", "paper"):
                words += few if "--until-decided" in words else [*few, "--trials", "1"]
            elif words[1] == "run":
                continue  # below
            assert exit_code(*words[1:]) == 0, (command, capsys.readouterr().err)


@pytest.mark.parametrize(("text", "method"), [(ROOM, "mcl"), (OFFICE, "mcl-map")])
def test_run_takes_it(room, capsys, text, method):
    room.write_text(text)
    Office(wings=1, corridors=1).grid.save("office.yaml")
    assert exit_code("run", *FEW, "--localizer", method, "--out", "lap") == 0
    assert "position RMSE" in capsys.readouterr().out
    assert (Path("lap") / "lap.webp").stat().st_size > 0


def test_paper_takes_it_from_any_folder_until_it_is_edited(room, monkeypatch, ran, refusal):
    given = (*FEW[2:], "--localizers", "mcl,dead-reckoning", "--trials", "1", "--jobs", "1")
    (room.parent / "elsewhere").mkdir()
    with without_report():
        assert exit_code("paper", *FEW[:2], *given, "--out", "one") == 0
        monkeypatch.chdir("elsewhere")
        there = ("paper", "--scenario", "../room.toml", *given, "--out", "../one")
        assert exit_code(*there) == 0
    assert len(ran) == 2
    manifest = json.loads((room.parent / "one" / "manifest.json").read_text())
    assert list(manifest["identity"]["plug-ins"]) == [str(room)]
    room.write_text(ROOM.replace("0.3", "0.4"))
    refusal(there, f"plug-ins.{room} was")


@pytest.mark.parametrize("prior", [IN_A_ROOM, PLACES])
def test_a_start_of_the_page_is_free_and_what_it_says(room, prior):
    Path("known.toml").write_text(f'base = "room.toml"\n{prior}')
    known = scenario("known.toml")
    at = known.prior_in(known.room()).sample(200, np.random.default_rng(0))
    assert known.room().floor_plan.free(at[at[:, 0] > 2.4]).all()  # not of the Gaussian place
    if prior is IN_A_ROOM:
        assert ((at[:, :2] >= 1.0) & (at[:, :2] <= (4.0, 3.0))).all()


def test_in_the_sweep_of_the_page_filters_assume_the_noise_of_each_world(tmp_path):
    (tmp_path / "sweep.toml").write_text(AS_WORLD)
    told = [Stage.of(trial) for trial in read_sweep(tmp_path / "sweep.toml").cells()]
    assert {stage.robot.motion.drive for stage in told} == {0.02, 0.1, 0.2}
    assert all(vars(stage.robot.motion) == vars(stage.room.world.noise) for stage in told)


def test_a_mistake_in_it_is_said_in_one_sentence_and_nothing_is_written(room, refusal):
    room.write_text(ROOM.replace("[env.driver]", "[env.drivr]"))
    said = f"deqmcl: {room}: unknown part of the world 'drivr': did you mean"
    for command in (("run", "--localizer", "mcl"), ("paper",)):
        refusal([*command, *FEW, "--out", "out"], said)
    assert [path.name for path in room.parent.iterdir()] == ["room.toml"]


ROUTE = """[env.lap]
waypoints = [[1.0, 1.0], [3.4, 1.0], [3.4, 2.4], [1.0, 2.4]]
[env.lidar]
beams = 16
field_of_view = 6.283
sigma = 0.1
[assumed.scan]
sigma = 0.1
"""
WAYS = {"[env]\nfloor_plan = 'maps/hall.yaml'\n": True}
WAYS["[env.floor_plan]\nfile = 'maps/hall.yaml'\nunknown = 'free'\n"] = False


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
