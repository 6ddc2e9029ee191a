"""Where a map is wrong: known changes are found, and nothing else is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import exit_code, lines

from benchmarks.robots.residuals import HIT, THROUGH, Residuals
from deqmcl_gym import logs

GONE, NEW = (slice(28, 40), slice(54, 60)), (slice(40, 46), slice(66, 72))  # cells of the hall


@pytest.fixture(scope="module")
def wrong(lap):
    """The hall on a map that lacks a wall of it, and has a box that is not there."""
    cells = lap[0].occupancy.copy()
    cells[GONE], cells[NEW] = 0, 100
    return replace(lap[0], occupancy=cells)


def residuals_of(floor_plan, log, poses=None):
    """Those of a log's scans, by default from where they were taken."""
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
    assert residuals_of(*lap).places == []


def test_a_missing_wall_is_hit_in_free_space_and_a_wall_too_many_is_seen_through(lap, wrong):
    places = residuals_of(wrong, lap[1]).places
    assert {place.kind for place in places} == {HIT, THROUGH}
    for place in places:
        # sensor noise of 0.02 m, cells of 0.1 m
        assert off(place, GONE if place.kind == HIT else NEW) <= 0.1 + 4 * 0.02
        assert place.poses >= 3
        assert 0.5 <= place.share <= 1
        assert place.at.size == place.cells


def test_places_are_ranked_by_evidence_and_a_blurred_map_is_told_from_things_that_moved(lap, wrong):
    _, log = lap
    found = residuals_of(wrong, log)
    evidence = [place.evidence for place in found.places]
    assert evidence == sorted(evidence, reverse=True)
    assert min(evidence) > 0
    half = residuals_of(wrong, log.of_records(slice(0, 30)))
    assert max(evidence) > max(place.evidence for place in half.places)  # fewer poses tell less
    assert "gathered, so things have moved" in found.said
    assert "All returns fit" in residuals_of(*lap).said
    poses = log.reference + np.random.default_rng(0).normal(0, [0.08, 0.08, 0], log.reference.shape)
    assert "at walls everywhere" in residuals_of(lap[0], log, poses).said


def test_one_pose_is_no_evidence_however_often_it_looks(lap, wrong):
    _, log = lap
    assert residuals_of(wrong, log).places
    still = log.of_records(np.full(200, 30))
    assert residuals_of(wrong, still).places == []


def test_scans_of_a_robot_that_is_lost_are_not_used(lap):
    hall, log = lap
    poses = np.tile([0.4, 3.0, 0.3], (len(log), 1))
    residuals = residuals_of(hall, log, poses)
    assert not residuals.used.any()
    assert residuals.places == []


def test_replay_writes_the_picture_and_a_line_per_place(lap, wrong, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, log = lap
    wrong.save("wrong.yaml")
    logs.Trajectory(log.times, log.reference).write("lap.tum")
    logs.write(replace(log, reference=None), "lap.csv")
    log_and_map = ["lap.csv", "--map", "wrong.yaml", "--reference", "lap.tum", "--out", "o"]
    how = ["--every", "0.1m,5deg", "--set", "assumed.scan.sigma=0.05", "--seeds", "1", "--jobs=1"]
    words = ["replay", *log_and_map, *how, "--localizers", "mcl", "--particles", "1000"]
    assert exit_code(*words, "--residuals") == 0
    said = capsys.readouterr().out
    kinds = [line["kind"] for line in lines(tmp_path / "o", "residuals.csv")]
    assert {HIT, THROUGH} == set(kinds), said
    places = f"{kinds.count(HIT)} place{'' if kinds.count(HIT) == 1 else 's'}"
    told = f"{places} hit in free space, {kinds.count(THROUGH)} seen through"
    assert told in said
    assert (tmp_path / "o/residuals.png").read_bytes().startswith(b"\x89PNG")
    assert "Where is the map wrong?" in (tmp_path / "o/report.html").read_text(encoding="utf-8")
    assert exit_code(*words) == 0  # without the option they go
    assert not (tmp_path / "o/residuals.png").exists()
