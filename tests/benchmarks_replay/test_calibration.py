"""The power of the scan model: beams that are wrong together tell less than they seem to."""

import math
from dataclasses import replace

import pytest
import test_yardstick

from benchmarks.replay.calibration import LEVEL, PART, calibrated
from benchmarks.replay.command import sweep_of
from benchmarks.replay.options import replay_of
from benchmarks.trials.attempt import attempt
from benchmarks.trials.plugins import key_of
from deqmcl_gym import logs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log of 2 laps whose map is 3 % too large: all beams are too short together."""
    folder = tmp_path_factory.mktemp("hall")
    test_yardstick.hall().save(folder / "hall.yaml")
    log = test_yardstick.recorded(0, laps=2)
    logs.write(replace(log, ranges=log.ranges / 1.03), folder / "log.npz")
    return folder


@pytest.fixture(scope="module")
def replay(folder):
    return replay_of(folder / "log.npz", folder / "hall.yaml", every="0.1m,5deg")


def share_within(replay):
    """Share of the reference within the 95 % region of mcl, where nothing was fitted on."""
    own = {"mcl": {"particles": 1000}}
    sweep = sweep_of(replay, ["mcl"], particles=None, seeds=1, root=1, shared={}, own=own)
    (trial,) = sweep.distinct()
    return attempt(trial, key_of(trial)).record.track.scores[f"coverage_{LEVEL}"]


def test_a_fitted_power_makes_beliefs_about_as_sure_as_they_may_be_on_the_rest_of_the_log(replay):
    fitted = calibrated(replay)
    assert fitted.scenario.scan.power < 1.0
    assert fitted.scenario.judged == math.ceil(PART * len(replay.log))
    sure, calm = share_within(replay), share_within(fitted)
    assert sure < 0.6
    assert 0.85 <= calm <= 1.0
    assert calibrated(replay) == fitted  # whenever it is made


def test_without_enough_of_a_reference_the_power_stays(replay, folder):
    for kept in ({"length": 250}, {"start": 400}):
        few = replace(replay, world=replay.world | kept)
        assert calibrated(few) == few
    log = logs.read(folder / "log.npz")
    logs.write(replace(log, reference=None), folder / "blind.npz")
    told = {"every": "0.1m,5deg", "start": "1.5,1.6,0"}
    blind = replay_of(folder / "blind.npz", folder / "hall.yaml", **told)
    assert calibrated(blind) == blind
