"""Puts this folder on the path: ``reference`` is shared by the tests of several folders.

Generated cases are the same in every run; ``--hypothesis-profile=many`` tries 500 new ones each.
"""

import pytest
from hypothesis import HealthCheck, settings

from benchmarks import console

patient = settings(database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("few", patient, max_examples=25, derandomize=True)
settings.register_profile("many", patient, max_examples=500)
settings.load_profile("few")


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Say nothing of what takes long: how long anything takes here is no matter of the test."""
    monkeypatch.setattr(console, "PATIENCE", 1e6)
