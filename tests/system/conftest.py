"""Two small runs of ``deqmcl paper``, made once and read by many tests."""

import pytest
from deqmcl_command import DEQMCL, SMALL, exit_code, process


@pytest.fixture(scope="session")
def small_run(tmp_path_factory):
    """The finished process ``deqmcl paper`` with two workers, and its output folder."""
    out = tmp_path_factory.mktemp("two_workers") / "results" / "paper"
    return process(DEQMCL, *SMALL, "--jobs", "2", "--out", out), out


@pytest.fixture(scope="session")
def one_worker(tmp_path_factory):
    """The folder of the same experiment, run in this process."""
    out = tmp_path_factory.mktemp("one_worker")
    assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 0
    return out
