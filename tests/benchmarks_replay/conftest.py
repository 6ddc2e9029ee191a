"""A hall, and a log of a lap in it, for all that is done with logs."""

import pytest
from hall import recorded_in_a_hall, write_lap


@pytest.fixture(scope="session")
def lap():
    """The hall, and the log of a lap in it."""
    return recorded_in_a_hall(steps=60)


@pytest.fixture
def recorded(lap, tmp_path, monkeypatch):
    """The current folder, with the hall, the log without poses, and its reference."""
    monkeypatch.chdir(tmp_path)
    write_lap(lap, tmp_path)
    return tmp_path
