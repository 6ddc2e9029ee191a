"""Bags of messages, read at once."""

import itertools

import pytest
from bags import bag
from drives import read_and_warned


@pytest.fixture
def heard(tmp_path):
    made = itertools.count()

    def read(*messages, **asked):
        return read_and_warned(bag(tmp_path / f"bag{next(made)}", *messages), **asked)

    return read
