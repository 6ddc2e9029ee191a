"""Puts this folder on the path: ``reference`` is shared by the tests of several folders.

Generated cases are the same in every run; ``--hypothesis-profile=many`` tries 500 new ones each.
"""

import pytest
from hypothesis import settings

from benchmarks import console

settings.register_profile("few", max_examples=25, derandomize=True, database=None)
settings.register_profile("many", max_examples=500, database=None)
settings.load_profile("few")


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Say nothing of what takes long: how long anything takes here is no matter of the test."""
    monkeypatch.setattr(console, "PATIENCE", 1e6)
