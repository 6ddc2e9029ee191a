"""``deqmcl check NAME --scan``: the laws of scan models hold for ours, and each can be broken."""

import pytest
from refusals import refused

from benchmarks.checks import check
from benchmarks.cli import main
from localizers.models.scan import BEAM_MODELS

MODEL = """
import numpy as np


class Model:
    def __init__(self, floor_plan, lidar):
        self.floor_plan, self.lidar, self.asked = floor_plan, lidar, 0

    def log_likelihood(self, states, scan):
        self.asked += 1
        expected = self.lidar.ranges(self.floor_plan, states, scan.usable)
        found = -np.abs(np.nan_to_num(expected) - scan.ranges[scan.usable]).sum(axis=1)
        {}
        return found
"""


@pytest.mark.parametrize("kind", BEAM_MODELS)
def test_our_scan_models_keep_all_laws(kind):
    assert check("scan models", kind).failed == ()


@pytest.mark.parametrize(
    ("law", "code"),
    [
        ("answers with numbers", "found = found[1:]"),
        ("answers with numbers", "found[0] = np.nan if scan.beams < scan.ranges.size else 0"),
        ("same input same answer", "found += self.asked"),
        ("inputs not changed", "states[2] = 0"),
        ("each pose by itself", "found -= found.max()"),
        ("global rng untouched", "np.random.random()"),
        ("the truth is likelier", "found[:] = 0"),
    ],
)
def test_each_law_is_broken_by_a_scan_model(tmp_path, law, code):
    (tmp_path / "mine.py").write_text(MODEL.format(code))
    failed = [verdict.law for verdict in check("scan models", f"{tmp_path}/mine.py").failed]
    assert law in failed


def test_the_command_tries_a_plug_in_and_tells_of_each_law(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MODEL.format(""))
    assert main(["check", "mine.py:Model", "--scan"]) == 0
    assert "mine.py:Model keeps all laws of scan models." in capsys.readouterr().out
    (tmp_path / "mine.py").write_text(MODEL.format("found[:] = 0"))
    assert main(["check", "mine.py:Model", "--scan"]) == 3
    assert "'the truth is likelier'" in capsys.readouterr().err


def test_a_scan_model_that_is_none_is_refused():
    with refused("unknown kind of scan 'beam'", "did you mean 'beam-model'"):
        check("scan models", "beam")
