"""Small runs of ``deqmcl paper``, made once and read by many tests; a small sweep."""

import contextlib
import io
import shutil
from pathlib import Path

import pytest
from deqmcl_command import SMALL, exit_code
from sweep_command import sweep, write_small


@pytest.fixture(scope="session")
def small_run(tmp_path_factory):
    """What a run by one process has printed; its folder."""
    out, said = tmp_path_factory.mktemp("small") / "paper", io.StringIO()
    with contextlib.redirect_stdout(said):
        assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 0
    return said.getvalue(), out


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
