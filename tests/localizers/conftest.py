"""The robot, the prior and the drive that most tests of the localizers share; plug-ins to load."""

import importlib
import sys

import numpy as np
import pytest
from following import robot_of

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.world import PAPER_ROOM

STRATEGIES = [
    {},
    {"ess_threshold": 0.5, "resampler": "stratified"},
    {"ess_threshold": 0.9, "resampler": "multinomial"},
]


@pytest.fixture(scope="session")
def room() -> PolygonMap:
    return PAPER_ROOM


@pytest.fixture(scope="session")
def robot(room) -> localizers.RobotModel:
    """One beam; a sensor and a motion that make weights differ and steps collide."""
    return robot_of(room, Lidar(beams=1, max_range=400.0), (0.2, 0.3, 0.02), sigma=30.0)


@pytest.fixture(scope="session")
def prior() -> localizers.GaussianPrior:
    return localizers.GaussianPrior(mean=(50.0, 40.0, 0.0), sd_position=15.0, sd_heading=0.2)


@pytest.fixture
def drive() -> tuple[np.ndarray, np.ndarray]:
    """Actions (12, 2) along the lower corridor and round its corner; scans (12, 1)."""
    straight, turn = (20.0, 0.0), (15.0, 0.4)
    actions = np.array([straight] * 8 + [turn] * 4)
    scans = np.array([280, 255, 240, 225, 195, 190, 150, 140, 130, 125, 160, 210.0])[:, None]
    return actions, scans


@pytest.fixture(params=STRATEGIES, ids=str)
def make(request, robot):
    """make(name, **params) with 60 particles, one of the strategies and a β of 2, if any."""

    def made(name: str, **params):
        beta = {"beta": 2.0} if "beta" in localizers.parameters(name) else {}
        return localizers.make(name, robot, **({"particles": 60} | request.param | beta | params))

    return made


WORKING = """
class Mine:
    def __init__(self, robot, *, gain=1.0):
        self.gain = gain
    def reset(self, prior, plan, rng): ...
    def update(self, ranges, action, plan): ...

class OnlyRobot(Mine):
    def __init__(self, robot): ...

class NoRobot(Mine):
    def __init__(self): ...

class NoUpdate:
    def __init__(self, robot): ...
    def reset(self, prior, plan, rng): ...

class Outer:
    Inner = Mine

def refuses(robot):
    raise ValueError("not this robot")

def none(robot):
    return None

number = 3
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(WORKING)
    return path


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A package on the path and in the working folder, forgotten afterwards: ``pack.good``, …"""
    folder = tmp_path / "site" / "pack"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "good.py").write_text(WORKING)
    (folder / "raises.py").write_text("x = 1\nraise ArithmeticError('no luck.')\n")
    (folder / "torn.py").write_text("ok = 1\ndef (:\n")
    monkeypatch.syspath_prepend(folder.parent)
    monkeypatch.chdir(folder.parent)
    yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "pack"]:
        del sys.modules[name]


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Make entry points known as an installed distribution would."""

    def install(lines, distribution="other"):
        site = tmp_path / f"site-{distribution}"
        info = site / f"{distribution}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1\n")
        (info / "entry_points.txt").write_text(f"[deqmcl.localizers]\n{lines}\n")
        monkeypatch.syspath_prepend(site)
        importlib.invalidate_caches()

    return install
