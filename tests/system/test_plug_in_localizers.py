"""Localizers from a file, scored beside the built-in ones: what they do not give is n/a."""

import csv

import pytest
from deqmcl_command import exit_code, files

PLUG_INS = '''
"""Two localizers, each without something."""

import numpy as np

from localizers import PointsBelief, PoseBelief
from localizers.template import MyLocalizer


class PoseOnly:
    """Has no particles, takes only a robot, and ignores scan and plan."""

    def __init__(self, robot):
        pass

    def reset(self, prior, plan, rng):
        self.pose = np.array(prior.mean)
        return PoseBelief(self.pose)

    def update(self, ranges, action, plan):
        self.pose[2] += action[1]
        self.pose[:2] += action[0] * np.array([np.cos(self.pose[2]), np.sin(self.pose[2])])
        return PoseBelief(self.pose)


def poses_without_weights(robot, particles=100):
    """A function for a factory."""
    return MyLocalizer(robot, particles=particles)

'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(PLUG_INS)
    return tmp_path


def paper(out, named, *more):
    few = ("--trials", "2", "--particles", "50", "--lag", "5")
    return exit_code("paper", *few, "--localizers", named, "--out", out, *more)


def rows(path):
    with path.open() as file:
        return {(row["method"], int(row["offset"])): row for row in csv.DictReader(file)}


def test_a_localizer_that_gives_only_a_pose_is_scored_and_what_it_lacks_is_empty(folder):
    name = "mine.py:PoseOnly"
    assert paper("out", f"mcl,{name},dead-reckoning", "--jobs", "1") == 0
    table = rows(folder / "out" / "results.csv")
    ours, theirs = table[name, 0], table["dead-reckoning", 0]
    assert float(ours["error"]) == pytest.approx(float(theirs["error"]), rel=1e-12)
    for spread in ("entropy", "var_x", "var_y", "var_cos", "var_sin"):
        assert ours[spread] == "", spread  # never 0
    assert [offset for method, offset in table if method == name] == [0]  # no past, no future
    assert "n/a" in (folder / "out" / "table.md").read_text()


def test_a_function_of_a_file_gives_the_same_numbers_on_one_and_two_processes(folder):
    named = "mcl,./mine.py:poses_without_weights"
    assert paper("one", named, "--jobs", "1") == 0
    assert paper("two", named, "--jobs", "2") == 0
    one, two = files(folder / "one"), files(folder / "two")
    for name in ("results.csv", "trials.csv"):
        assert one[name] == two[name]


def test_a_lap_of_a_localizer_from_a_file_can_be_run(folder, capsys):
    arguments = ("--localizer", "mine.py:PoseOnly", "--out", "lap")
    assert exit_code("run", *arguments) == 0
    assert "mine.py:PoseOnly" in capsys.readouterr().out
    assert (folder / "lap" / "lap.webp").stat().st_size > 0


def test_a_name_that_cannot_be_resolved_is_refused_before_anything_is_written(folder, capsys):
    assert paper("out", "mcl,mine.py:PoseOnyl") == 2
    assert "(did you mean 'PoseOnly'?)" in capsys.readouterr().err
    assert not (folder / "out").exists()
