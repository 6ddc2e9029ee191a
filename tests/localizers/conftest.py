"""The robot, the prior and the drive that most tests of the localizers share."""

import numpy as np
import pytest

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap


@pytest.fixture(scope="session")
def room() -> PolygonMap:
    return PolygonMap(
        outer=[(0, 0), (350, 0), (350, 300), (0, 300)],
        obstacles=[[(100, 100), (250, 100), (250, 200), (100, 200)]],
    )


@pytest.fixture(scope="session")
def robot(room) -> localizers.RobotModel:
    """One beam; a sensor and a motion that make weights differ and steps collide."""
    return localizers.RobotModel(
        floor_plan=room,
        lidar=Lidar(beams=1, max_range=400.0),
        motion=localizers.OdometryMotion(drive=0.2, turn=0.3, drift=0.02),
        scan=localizers.GaussianUniform(sigma=30.0),
    )


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
