"""Small runs of ``deqmcl paper``, made once and read by many tests; a small sweep."""

import shutil
from pathlib import Path

import pytest
from deqmcl_command import DEQMCL, SMALL, exit_code, process
from sweep_command import sweep, write_small


@pytest.fixture(scope="session")
def small_run(tmp_path_factory):
    out = tmp_path_factory.mktemp("two_workers") / "results" / "paper"
    return process(DEQMCL, *SMALL, "--jobs", "2", "--out", out), out


@pytest.fixture(scope="session")
def one_worker(tmp_path_factory):
    out = tmp_path_factory.mktemp("one_worker")
    assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 0
    return out


@pytest.fixture(scope="session")
def file(tmp_path_factory):
    return write_small(tmp_path_factory.mktemp("file"))


@pytest.fixture(scope="session")
def finished(file, tmp_path_factory):
    out = tmp_path_factory.mktemp("finished") / "out"
    assert sweep(file, out) == 0
    return out


@pytest.fixture
def copy(finished, tmp_path):
    return Path(shutil.copytree(finished, tmp_path / "copy"))
