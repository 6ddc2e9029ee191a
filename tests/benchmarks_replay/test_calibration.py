"""The power of the scan model: beams that are wrong together tell less than they seem to."""

from dataclasses import replace

import numpy as np
import pytest
import test_yardstick

from benchmarks.replay.calibration import LEVEL, calibrated, fitted_power
from benchmarks.replay.playing import replay
from benchmarks.replay.setting import Told, robot_of, setting_of
from localizers import make


@pytest.fixture(scope="module")
def setting(tmp_path_factory):
    """A log of 2 laps whose map is 3 % too large: all beams are too short together."""
    path = tmp_path_factory.mktemp("hall") / "hall.yaml"
    test_yardstick.hall().save(path)
    log = test_yardstick.recorded(0, laps=2)
    return setting_of(replace(log, ranges=log.ranges / 1.03), path, Told(every="0.1m,5deg"))


def share_within(setting, seed):
    """Share of the reference within the 95 % region of mcl, where nothing was fitted on."""
    env = setting.env()
    robot, prior = robot_of(setting, env)
    track = replay(env, make("mcl", robot, particles=1000), prior, np.random.default_rng(seed))
    ranks = track.ranks[setting.judged :]
    return np.mean(ranks[np.isfinite(ranks)] <= LEVEL)


def test_a_fitted_power_makes_beliefs_about_as_sure_as_they_may_be_on_the_rest_of_the_log(setting):
    fitted = calibrated(setting)
    fit = fitted_power(setting)
    assert fit is not None
    assert fitted.scan.power == fit.power < 1.0
    assert fitted.judged == fit.records
    sure, calm = share_within(setting, 1), share_within(fitted, 1)
    assert fit.untempered == pytest.approx(sure, abs=0.25)  # one part of the log for another
    assert sure < 0.6
    assert 0.85 <= calm <= 1.0


def test_the_fit_does_not_depend_on_when_it_is_made(setting):
    assert fitted_power(setting) == fitted_power(setting)


def test_without_enough_of_a_reference_the_power_stays(setting):
    few = replace(setting, log=setting.log.segment(0, 200))
    assert fitted_power(few) is None
    assert calibrated(few) == few
    blind = replace(setting, log=replace(setting.log, reference=None))
    assert fitted_power(blind) is None
