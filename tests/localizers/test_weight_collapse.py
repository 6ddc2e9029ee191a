"""Evidence that every particle denies: counted, dropped, the weights of before kept; never NaN."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from following import follow, started, updated

import localizers
from deqmcl_gym.maps import Lidar

INF = math.inf
INTO_THE_WALL = np.tile([-80.0, 0.0], (6, 1))  # from (50, 50, 0): x = -30 after the first step
AHEAD = np.tile([10.0, 0.0], (6, 1))
SCANS = np.full((6, 1), 250.0)


@pytest.fixture(autouse=True)
def _no_warnings():
    """inf - inf and 0 · inf would say so."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.fixture
def steady(robot) -> localizers.RobotModel:
    """A robot that turns so little by itself that every particle drives where it is told."""
    return replace(robot, motion=localizers.OdometryMotion(drive=0.1, turn=0.1, drift=0.0005))


@pytest.fixture
def start() -> localizers.GaussianPrior:
    return localizers.GaussianPrior(mean=(50.0, 50.0, 0.0), sd_position=3.0, sd_heading=0.02)


def assert_sound(belief) -> None:
    for offset in range(-6, 7):
        if (points := belief.points(offset)) is not None:
            assert np.isfinite(points[0]).all()
            assert (points[1] >= 0).all()
            assert points[1].sum() == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["mcl-map", "mcl-map-smoother", "deq-mcl"])
@pytest.mark.parametrize("ess_threshold", [None, 0.5])
def test_with_infinite_beta_and_all_colliding_the_weights_are_those_of_the_scan_alone(
    steady, start, name, ess_threshold
):
    params = {"particles": 50, "ess_threshold": ess_threshold}
    collapsed, uncharged = (
        updated(name, steady, start, [40.0], [-80.0, 0.0], beta=beta, **params) for beta in (INF, 0)
    )
    assert uncharged.events.weight_collapses == 0
    assert collapsed.events.weight_collapses == 1
    assert np.array_equal(collapsed.points()[1], uncharged.points()[1])
    assert_sound(collapsed)


def test_a_scan_model_that_can_be_zero_collapses_and_is_counted(room, start):
    scan = localizers.GaussianUniform(sigma=0.5, uniform=0.0)
    robot = localizers.RobotModel(floor_plan=room, lidar=Lidar(), scan=scan)
    localizer = started("mcl", robot, start, particles=50)
    belief = localizer.update([10.0], [0.0, 0.0], [])  # 300 px seen: z = 580, density 0
    assert belief.events.weight_collapses == 1
    assert belief.points()[1].tolist() == [1 / 50] * 50
    assert localizer.update([300.0], [0.0, 0.0], []).events.weight_collapses == 1


@pytest.mark.parametrize("ess_threshold", [None, 0.0, 0.5])
@pytest.mark.parametrize("pilots", [1, 16])
@pytest.mark.parametrize("beta", [200.0, INF])
@pytest.mark.parametrize("planned", [INTO_THE_WALL, np.tile([-25.0, 0.0], (6, 1))])
def test_a_plan_into_the_wall_that_is_given_up_leaves_sound_weights(
    steady, start, planned, beta, pilots, ess_threshold
):
    # The queued future collides for all particles or many; then another plan is driven.
    params = {"particles": 50, "lag": 3, "beta": beta, "ess_threshold": ess_threshold}
    localizer = localizers.make("deq-mcl", steady, pilots=pilots, **params)
    plans = [planned, *(AHEAD[t:] for t in range(1, 7))]
    beliefs = follow(localizer, start, (AHEAD, SCANS), plans=plans)
    for belief in beliefs:
        assert_sound(belief)
        assert math.isfinite(belief.log_evidence)
    assert beliefs[-1].events.replanned_steps == 1


@pytest.mark.parametrize(
    ("name", "params"),
    [
        *(("deq-mcl", {"pilots": pilots}) for pilots in (1, 16)),
        *(("deq-mcl-fresh", {"evidence": evidence}) for evidence in ("plan", "future")),
    ],
    ids=str,
)
@pytest.mark.parametrize("ess_threshold", [None, 0.0, 0.5])
def test_a_new_plan_into_the_wall_leaves_sound_weights(steady, start, name, params, ess_threshold):
    params = {"particles": 50, "lag": 3, "beta": INF, "ess_threshold": ess_threshold, **params}
    localizer = localizers.make(name, steady, **params)
    plans = [AHEAD, AHEAD[1:], *(INTO_THE_WALL[t:] for t in range(2, 7))]
    beliefs = follow(localizer, start, (AHEAD, SCANS), plans=plans)
    for belief in beliefs:
        assert_sound(belief)
    events = beliefs[2].events  # evidence that every particle contradicts is dropped, and counted
    assert events.weight_collapses + events.infeasible_plans >= 1
