"""``deqmcl new-map``: what it writes is the office, in both forms; it overwrites nothing."""

import pytest
from deqmcl_command import exit_code

from deqmcl_gym import GridMap, Office
from deqmcl_gym.maps import polygon_file


def test_both_files_are_the_office(tmp_path, capsys):
    out = tmp_path / "new"
    size = ["--wings", "2", "--corridors", "1", "--corridor", "1.5", "--door", "1.1"]
    said = ["new-map", "office", "--seed", "5", *size, "--symmetric", "--out", str(out)]
    assert exit_code(*said) == 0
    office = Office(seed=5, wings=2, corridors=1, corridor=1.5, door=1.1, symmetric=True)
    assert (GridMap.load(out / "office.yaml").solid == office.grid.solid).all()
    assert polygon_file.read(out / "office.json") == office.polygons
    assert sorted(path.name for path in out.iterdir()) == [
        "office.json",
        "office.pgm",
        "office.yaml",
    ]
    assert "office.yaml" in capsys.readouterr().out


def test_a_folder_with_files_is_left_as_it_is(tmp_path, capsys):
    (tmp_path / "office.json").write_text("mine")
    assert exit_code("new-map", "office", "--out", str(tmp_path)) == 2
    assert "is not empty" in capsys.readouterr().err
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize("said", [["--door", "0.85"], ["--wings", "3", "--symmetric"]])
def test_what_cannot_be_built_leaves_no_folder(tmp_path, capsys, said):
    out = tmp_path / "new"
    assert exit_code("new-map", "office", *said, "--out", str(out)) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


def test_a_scenario_file_names_an_office(tmp_path):
    from benchmarks.setup.names import scenario

    path = tmp_path / "building.toml"
    path.write_text(
        "[env.floor_plan.office]\nseed = 3\nwings = 1\n"
        "[env.lap]\nwaypoints = [[1.2, 1.2], [1.2, 8.0], [1.3, 8.0]]\n"
    )
    assert scenario(str(path)).world.floor_plan is Office(seed=3, wings=1).grid
