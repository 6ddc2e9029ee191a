"""What is wrong with a log or a map: planted faults are told with their sizes and places."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import exit_code, lines
from drives import recorded_in_a_hall, write_lap

from benchmarks.robots import replay_of
from benchmarks.robots.calibration import doubts_of
from benchmarks.robots.residuals import HIT, THROUGH, Residuals
from deqmcl_gym import logs
from deqmcl_gym.logs.motion import dead_reckoned, increments_of

GONE, NEW = (slice(28, 40), slice(54, 60)), (slice(40, 46), slice(66, 72))  # cells of the hall


@pytest.fixture(scope="module")
def rounds():
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
    told = increments_of(log.odometry) / [distance, distance, turn]
    told[:, 2] -= veer * np.abs(told[:, 0])
    return replace(log, odometry=dead_reckoned(told, log.odometry[0]))


def unsigned(log):
    told = increments_of(log.odometry)
    told[:, 0] = np.abs(told[:, 0])
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
        (unsigned, 0.0, ["no sign", "m that it goes ahead", "at 100."]),
    ],
)
def test_a_planted_fault_alone_is_told_with_its_size(rounds, here, fault, late, words):
    hall, log = rounds
    write_lap((hall, fault(log)), here)
    logs.Trajectory(log.times + late, log.reference).write("lap.tum")
    told = doubts_of(replay_of("lap.csv", "hall.yaml", reference="lap.tum").scenario)
    assert len(told) == bool(words), told
    assert [word for word in words if word not in told[0]] == []


def test_a_reference_whose_stamps_are_no_records_tells_of_no_wheels(rounds, here):
    write_lap(rounds, here)
    logs.Trajectory(rounds[1].times[::5] + 0.1, rounds[1].reference[::5]).write("lap.tum")
    assert doubts_of(replay_of("lap.csv", "hall.yaml", reference="lap.tum").scenario) == []


def test_score_tells_of_an_estimate_that_is_late(rounds, here, capsys):
    write_lap(rounds, here)
    logs.Trajectory(rounds[1].times + 0.5, rounds[1].reference).write("slam.tum")
    for by in (["--log", "lap.csv"], []):
        assert exit_code("score", "slam.tum", "--reference", "lap.tum", *by, "--out", "s") == 0
        told = re.search(r"Warning: slam seems ([\d.]+) s .* late", capsys.readouterr().err)
        assert float(told[1]) == pytest.approx(0.5, abs=0.02)
        assert "covers" not in told.string
    logs.Trajectory(rounds[1].times[:50], rounds[1].reference[:50]).write("part.tum")
    assert exit_code("score", "part.tum", "--reference", "lap.tum", "--out", "p") == 0
    assert "% of the reference's time" in capsys.readouterr().err


@pytest.fixture(scope="module")
def wrong(lap):
    """The hall on a map that lacks a wall of it, and has a box that is not there."""
    cells = lap[0].occupancy.copy()
    cells[GONE], cells[NEW] = 0, 100
    return replace(lap[0], occupancy=cells)


def residuals_of(floor_plan, log, poses=None):
    at = log.reference if poses is None else poses
    return Residuals(floor_plan, log.scanner, at, log.ranges)


def off(place, cells):
    """Distance of a place's centre from a block of cells, in m."""
    (rows, columns), resolution = cells, 0.05
    nearest = (
        np.clip(place.x, resolution * columns.start, resolution * columns.stop),
        np.clip(place.y, resolution * rows.start, resolution * rows.stop),
    )
    return math.hypot(place.x - nearest[0], place.y - nearest[1])


def test_a_map_that_is_right_has_no_wrong_place(lap):
    assert residuals_of(*lap).places.empty


def test_a_missing_wall_is_hit_in_free_space_and_a_wall_too_many_is_seen_through(lap, wrong):
    places = residuals_of(wrong, lap[1]).places
    assert {*places["kind"]} == {HIT, THROUGH}
    for place in places.itertuples():
        # sensor noise of 0.02 m, cells of 0.1 m
        assert off(place, GONE if place.kind == HIT else NEW) <= 0.1 + 4 * 0.02
        assert place.poses >= 3
        assert 0.5 <= place.share <= 1
        assert place.at.size == place.cells


def test_places_are_ranked_by_evidence_and_a_blurred_map_is_told_from_things_that_moved(lap, wrong):
    _, log = lap
    found = residuals_of(wrong, log)
    evidence = [*found.places["evidence"]]
    assert evidence == sorted(evidence, reverse=True)
    assert min(evidence) > 0
    half = residuals_of(wrong, log.of_records(slice(0, 30)))
    assert max(evidence) > half.places["evidence"].max()  # fewer poses tell less
    assert "gathered, so things have moved" in found.said
    assert "All returns fit" in residuals_of(*lap).said
    poses = log.reference + np.random.default_rng(0).normal(0, [0.08, 0.08, 0], log.reference.shape)
    assert "at walls everywhere" in residuals_of(lap[0], log, poses).said


def test_one_pose_is_no_evidence_however_often_it_looks(lap, wrong):
    _, log = lap
    assert not residuals_of(wrong, log).places.empty
    still = log.of_records(np.full(200, 30))
    assert residuals_of(wrong, still).places.empty


def test_scans_of_a_robot_that_is_lost_are_not_used(lap):
    hall, log = lap
    poses = np.tile([0.4, 3.0, 0.3], (len(log), 1))
    residuals = residuals_of(hall, log, poses)
    assert not residuals.used.any()
    assert residuals.places.empty


def test_replay_writes_the_picture_and_a_line_per_place(lap, wrong, here, capsys):
    _, log = lap
    wrong.save("wrong.yaml")
    logs.Trajectory(log.times, log.reference).write("lap.tum")
    logs.write(replace(log, reference=None), "lap.csv")
    log_and_map = ["lap.csv", "--map", "wrong.yaml", "--reference", "lap.tum", "--out", "o"]
    how = ["--every", "0.1m,5deg", "--set", "assumed.scan.sigma=0.05", "--seeds", "1", "--jobs=1"]
    words = ["replay", *log_and_map, *how, "--localizers", "mcl", "--particles", "1000"]
    assert exit_code(*words, "--residuals") == 0
    said = capsys.readouterr().out
    kinds = [line["kind"] for line in lines(here / "o", "residuals.csv")]
    assert {HIT, THROUGH} == set(kinds), said
    places = f"{kinds.count(HIT)} place{'' if kinds.count(HIT) == 1 else 's'}"
    told = f"{places} hit in free space, {kinds.count(THROUGH)} seen through"
    assert told in said
    assert (here / "o/residuals.png").read_bytes().startswith(b"\x89PNG")
    assert "Where is the map wrong?" in (here / "o/report.html").read_text(encoding="utf-8")
    assert exit_code(*words) == 0  # without the option they go
    assert not (here / "o/residuals.png").exists()
