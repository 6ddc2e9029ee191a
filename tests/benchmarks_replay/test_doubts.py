"""Faults that are planted into a log are told with their numbers; a sound log has none."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import exit_code
from hall import recorded_in_a_hall, write_lap

from benchmarks.robots.calibration import doubts_of
from benchmarks.robots.played import replay_of
from deqmcl_gym import logs
from deqmcl_gym.logs.motion import dead_reckoned, increments_of


@pytest.fixture(scope="module")
def lap():
    """The hall, and rounds in it, the last ones backwards; wheels and ranges have some noise."""
    hall, short = recorded_in_a_hall(steps=1)
    rng, at = np.random.default_rng(0), np.linspace(0, 12 * np.pi, 500)
    at = np.concatenate([at, at[::-1]])
    heading = np.arctan2(1.0 * np.cos(at), -1.5 * np.sin(at))
    poses = np.column_stack([2.2 + 1.5 * np.cos(at), 1.7 + np.sin(at), heading])
    told = increments_of(poses) * rng.normal(1, 0.02, (len(poses) - 1, 3))
    ranges = hall.ranges(poses, short.scanner.bearings)
    ranges += rng.normal(0, 0.02, ranges.shape)
    odometry = dead_reckoned(told, poses[0])
    return hall, logs.Log(short.scanner, 0.2 * np.arange(1000), odometry, ranges, poses)


def mounted(log, ahead, left, turn):
    """The log with a wrong mounting of its lidar: that of the robot is (0, 0, 0)."""
    angles = tuple(log.scanner.bearings - turn)
    return replace(log, scanner=replace(log.scanner, angles=angles, mounting=(-ahead, -left)))


def wheeled(log, distance, turn, veer):
    """The log with odometry of wrong wheels."""
    told = increments_of(log.odometry) / [distance, distance, turn]
    told[:, 2] -= veer * np.abs(told[:, 0])
    return replace(log, odometry=dead_reckoned(told, log.odometry[0]))


@pytest.mark.parametrize(
    ("fault", "late", "words"),
    [
        (lambda log: log, 0.0, []),
        (lambda log: log, 0.5, ["the reference seems 0.", " late", "subtract that"]),
        (lambda log: log, -0.5, ["the reference seems 0.", " early", "add that"]),
        (lambda log: mounted(log, 0, 0, math.radians(3)), 0.0, ["turned by 3", "mounting=["]),
        (lambda log: mounted(log, 0.1, -0.1, 0), 0.0, ["moved by 0.1", "and -0.1"]),
        (lambda log: mounted(log, 0, 0, math.pi / 2), 0.0, ["the lidar seems turned by 90."]),
        (lambda log: wheeled(log, 0.95, 1, 0), 0.0, ["goes 0.95", "times as far"]),
        (lambda log: wheeled(log, 1, 1.05, 0), 0.0, ["turns 1.05", "times as much"]),
        (lambda log: wheeled(log, 1, 1, math.radians(5)), 0.0, ["veers 5."]),
    ],
)
def test_a_planted_fault_is_told_with_its_size_and_nothing_else(
    lap, tmp_path, monkeypatch, fault, late, words
):
    monkeypatch.chdir(tmp_path)
    hall, log = lap
    write_lap((hall, fault(log)), tmp_path)
    logs.Trajectory(log.times + late, log.reference).write("lap.tum")
    told = doubts_of(replay_of("lap.csv", "hall.yaml", reference="lap.tum").scenario)
    assert len(told) == bool(words), told
    assert [word for word in words if word not in told[0]] == []


def test_a_reference_whose_stamps_are_no_records_tells_of_no_wheels(lap, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_lap(lap, tmp_path)
    logs.Trajectory(lap[1].times[::5] + 0.1, lap[1].reference[::5]).write("lap.tum")
    assert doubts_of(replay_of("lap.csv", "hall.yaml", reference="lap.tum").scenario) == []


def test_score_tells_of_an_estimate_that_is_late(lap, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_lap(lap, tmp_path)
    logs.Trajectory(lap[1].times + 0.5, lap[1].reference).write("slam.tum")
    for by in (["--log", "lap.csv"], []):
        assert exit_code("score", "slam.tum", "--reference", "lap.tum", *by, "--out", "s") == 0
        told = re.search(r"Warning: slam seems ([\d.]+) s .* late", capsys.readouterr().err)
        assert float(told[1]) == pytest.approx(0.5, abs=0.02)
