"""A hall, and a log of a lap in it, for all that is done with logs."""

import pytest
from drives import recorded_in_a_hall, write_lap


@pytest.fixture(scope="session")
def lap():
    return recorded_in_a_hall(steps=60)


@pytest.fixture
def recorded(lap, here):
    """The current folder, with the hall, the log without poses, and its reference."""
    write_lap(lap, here)
    return here
