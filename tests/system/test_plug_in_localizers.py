"""Localizers from a file, scored beside the built-in ones: what they do not give is n/a."""

import pytest
from deqmcl_command import exit_code, lines
from sweep_command import without_report

PLUG_IN = '''
"""A localizer without particles, past and future."""

import numpy as np

from localizers import PoseBelief


class PoseOnly:
    """Takes only a robot, and ignores scan and plan."""

    def __init__(self, robot):
        pass

    def reset(self, prior, plan, rng):
        self.pose = np.array(prior.mean)
        return PoseBelief(self.pose)

    def update(self, ranges, action, plan):
        self.pose[2] += action[1]
        self.pose[:2] += action[0] * np.array([np.cos(self.pose[2]), np.sin(self.pose[2])])
        return PoseBelief(self.pose)
'''
NAME = "mine.py:PoseOnly"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(PLUG_IN)
    return tmp_path


def test_a_localizer_that_gives_only_a_pose_is_scored_and_what_it_lacks_is_empty(folder, refusal):
    few = ("--trials", "2", "--particles", "50", "--lag", "5")
    paper = ("paper", *few, "--localizers", f"mcl,{NAME},dead-reckoning", "--out")
    with without_report():
        assert exit_code(*paper, "one", "--jobs", "1") == 0
    rows = {(r["method"], r["offset"]): r for r in lines(folder / "one", "results.csv")}
    ours, theirs = rows[NAME, "0"], rows["dead-reckoning", "0"]
    assert float(ours["error"]) == pytest.approx(float(theirs["error"]), rel=1e-12)
    for spread in ("entropy", "var_x", "var_y", "var_cos", "var_sin"):
        assert ours[spread] == "", spread  # never 0
    assert [offset for method, offset in rows if method == NAME] == ["0"]  # no past, no future
    assert "n/a" in (folder / "one" / "table.md").read_text()
    (folder / "mine.py").write_text(f"{PLUG_IN}\n# changed\n")
    refusal([*paper, "one"], f"plug-ins.{NAME} was")
