"""Puts this folder on the path: ``reference`` is shared by the tests of several folders.

Generated cases are the same in every run; ``--hypothesis-profile=many`` tries 500 new ones each.
"""

import gc
import re

import pytest
from deqmcl_command import exit_code
from hypothesis import HealthCheck, settings

from benchmarks import console
from benchmarks.trials.stage import Stage

pytest_plugins = ["pytester"]

patient = settings(database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("few", patient, max_examples=25, derandomize=True)
settings.register_profile("many", patient, max_examples=500)
settings.load_profile("few")


def pytest_collection_finish():
    gc.freeze()  # what was collected is not searched whenever a law is tried


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Say nothing of what takes long: how long anything takes here is no matter of the test."""
    monkeypatch.setattr(console, "PATIENCE", 1e6)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A temporary folder, in which the test runs."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ran(monkeypatch):
    """Trials that were run rather than found."""
    found, run = [], Stage.moments
    monkeypatch.setattr(
        Stage, "moments", lambda stage, *how: found.append(stage.trial) or run(stage, *how)
    )
    return found


@pytest.fixture
def refusal(capsys):
    """Run a command that must refuse in one sentence with these words and print nothing else."""

    def run(command, *words):
        capsys.readouterr()
        assert exit_code(*command) == 2
        out, sentence = capsys.readouterr()
        assert out == ""
        assert re.fullmatch(r"deqmcl\b.*\.\n", sentence), sentence
        assert [word for word in words if word not in sentence] == []
        return sentence

    return run
