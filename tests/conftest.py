"""Puts this folder on the path: ``reference`` is shared by the tests of several folders."""

import pytest

from benchmarks import console


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Say nothing of what takes long: how long anything takes here is no matter of the test."""
    monkeypatch.setattr(console, "PATIENCE", 1e6)
