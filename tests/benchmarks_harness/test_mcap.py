"""``--mcap``: read back by the library ``mcap``, its messages by the wire format of protobuf."""

import io
import json
import math
import struct
import sys
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import exit_code, files
from drives import recorded_in_a_hall, write_lap
from mcap.reader import make_reader
from refusals import refused
from report_cases import trial_of

from benchmarks.report.laps import mcap_file, showing, shown_again
from benchmarks.trials.stage import Stage
from deqmcl_gym import logs
from deqmcl_gym.logs.motion import dead_reckoned
from localizers import best_cluster

FIXED, BYTES = {1: "<d", 5: "<I"}, 2  # wire types
RUN = ("run", "--scenario", "guided", "--localizer", "mcl", "--particles", "20")
REPLAY = (
    *("replay", "lap.csv", "--map", "hall.yaml", "--localizers", "mcl,amcl", "--particles", "50"),
    *("--set", "assumed.scan.power=0.5", "--seeds", "1", "--jobs", "1"),
)


def decoded(data):
    """The fields of a protobuf message by number: lists of doubles, whole numbers and bytes."""
    found, stream = {}, io.BytesIO(data)

    def varint():
        (byte,) = stream.read(1)
        return byte if byte < 128 else byte - 128 + (varint() << 7)

    while stream.tell() < len(data):
        number, kind = divmod(varint(), 8)
        if kind in FIXED:
            (value,) = struct.unpack(FIXED[kind], stream.read(struct.calcsize(FIXED[kind])))
        else:
            value = varint()
        found.setdefault(number, []).append(stream.read(value) if kind == BYTES else value)
    return found


def one(message, number, otherwise=b""):
    return message.get(number, [otherwise])[0]


def pose_of(data):
    """x, y, θ of a Pose: position 1 (x 1, y 2), orientation 2 (z 3, w 4)."""
    pose = decoded(data)
    at, turned = decoded(one(pose, 1)), decoded(one(pose, 2))
    heading = 2 * math.atan2(one(turned, 3, 0.0), one(turned, 4, 0.0))
    return one(at, 1, 0.0), one(at, 2, 0.0), heading


def read(path):
    """Messages (log time s, schema, content) by topic."""
    found = {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            told = message.log_time / 1e9, schema.name, message.data
            found.setdefault(channel.topic, []).append(told)
    return found


SCHEMAS = {
    "/map": "foxglove.SceneUpdate",
    "/tf": "foxglove.FrameTransform",
    "/truth": "foxglove.PoseInFrame",
    "/scan": "foxglove.PointCloud",
    "/H/estimate": "foxglove.PoseInFrame",
    "/H/cloud": "foxglove.PointCloud",
    "/H/advised": "foxglove.PointCloud",
    "/H/protected": "foxglove.PointCloud",
    "/H/plan": "foxglove.SceneUpdate",
    "/H/series": "deqmcl.Series",
}


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    """The first steps of a hedge in the paper's room, in px, beside what is in the file."""
    few = {"particles": 50}
    trial = trial_of("mcl-plan-hedged", 0, scenario="guided", params=few, lag=0, seed=1)
    stage, path = Stage.of(trial), tmp_path_factory.mktemp("mcap") / "new" / "a.mcap"
    episode = (moment for moment in stage.moments() if moment.t <= 12)
    kept = []
    with showing(path, {"H": episode}, stage) as rows:
        for (moment,) in rows:
            belief = moment.belief
            kept.append((moment, belief.points(), belief.advised.points(),
                         belief.protected.points(), belief.trusted))  # fmt: skip
    return stage, kept, read(path), path


def test_every_topic_has_its_standard_schema_and_a_message_for_every_step(lap):
    _, kept, topics, path = lap
    assert {topic: own[0][1] for topic, own in topics.items()} == SCHEMAS
    assert len(kept) == 13
    for topic, own in topics.items():
        times = [0.0] if topic == "/map" else [float(step) for step in range(13)]
        assert [time for time, _, _ in own] == times, topic
    assert [other.name for other in path.parent.iterdir()] == ["a.mcap"]  # nothing beside it


def test_poses_and_clouds_are_those_of_the_run_in_metres(lap):
    _, kept, topics, _ = lap
    for step, (moment, present, advised, protected, _) in enumerate(kept):
        x, y, heading = np.asarray(moment.truth, np.float64)
        best = best_cluster(*present, unit="px").mean
        stamp, frame, pose = (one(decoded(topics["/truth"][step][2]), i) for i in (1, 2, 3))
        assert (one(decoded(stamp), 1, 0), frame) == (step, b"map")
        expected = (x / 50, y / 50, math.remainder(heading, 2 * math.pi))
        off = np.array(pose_of(pose)) - expected
        off[2] = math.remainder(off[2], 2 * math.pi)
        np.testing.assert_allclose(off, 0, atol=1e-9)
        estimate = pose_of(one(decoded(topics["/H/estimate"][step][2]), 3))
        np.testing.assert_allclose(estimate[:2], np.array(best[:2]) / 50, rtol=1e-12)
        base = decoded(topics["/tf"][step][2])
        assert (one(base, 2), one(base, 3)) == (b"map", b"base_link")
        moved = decoded(one(base, 4))
        np.testing.assert_allclose((one(moved, 1, 0.0), one(moved, 2, 0.0)), (x / 50, y / 50))
        for name, points in (("cloud", present), ("advised", advised), ("protected", protected)):
            cloud = decoded(topics[f"/H/{name}"][step][2])
            table = np.frombuffer(one(cloud, 6), "<f4").reshape(-1, 5)
            poses, weights = np.asarray(points[0], np.float64), np.asarray(points[1])
            assert one(cloud, 4) == 20
            np.testing.assert_allclose(table[:, :2], poses[:, :2] / 50, rtol=1e-6)
            np.testing.assert_allclose(table[:, 3:], np.column_stack([poses[:, 2], weights]),
                                       rtol=1e-6, atol=1e-30)  # fmt: skip
    clouds = [one(decoded(topics[f"/H/{name}"][9][2]), 6) for name in ("advised", "protected")]
    assert clouds[0] != clouds[1]


def test_scans_plans_and_series_are_those_of_the_run(lap):
    stage, kept, topics, _ = lap
    lidar = stage.room.lidar
    for step, (moment, present, _, _, trusted) in enumerate(kept):
        scan = decoded(topics["/scan"][step][2])
        ends = np.frombuffer(one(scan, 6), "<f4").reshape(-1, 5)[:, :2]
        hit = np.asarray(moment.ranges) <= lidar.max_range
        rays = np.column_stack([np.cos(lidar.bearings), np.sin(lidar.bearings)])
        expected = (np.asarray(moment.ranges)[:, None] * rays)[hit] / 50
        np.testing.assert_allclose(ends, expected, atol=1e-5)
        (entity,) = decoded(topics["/H/plan"][step][2]).get(2, [b""])
        lines = decoded(entity).get(11, [])
        way = dead_reckoned(moment.plan, moment.truth)[:, :2] / 50
        way = way if len(moment.plan) else way[:0]
        points = [decoded(p) for line in lines for p in decoded(line).get(5, [])]
        drawn = [(one(p, 1, 0.0), one(p, 2, 0.0)) for p in points]
        np.testing.assert_allclose(np.reshape(drawn, (-1, 2)), way, rtol=1e-9)
        series = json.loads(topics["/H/series"][step][2])
        off = np.array(best_cluster(*present, unit="px").mean) - moment.truth
        assert series["step"] == step
        assert series["trusted"] == pytest.approx(trusted)
        assert series["position_error_m"] == pytest.approx(math.hypot(*off[:2]) / 50)


@pytest.fixture
def hall(here):
    lap = recorded_in_a_hall(steps=40)
    write_lap(lap, here)
    logs.write(lap[1], "lap.csv")  # with its reference
    return lap


def test_a_replay_has_its_localizers_side_by_side_at_the_times_of_the_log(hall, tmp_path):
    floor_plan, _ = hall
    assert exit_code(*REPLAY, "--every", "0.05m,2deg", "--mcap", "a.mcap", "--out", "out") == 0
    topics = read(tmp_path / "a.mcap")
    played = np.loadtxt(tmp_path / "out/tracks/mcl-0.tum")
    assert [t for t, _, _ in topics["/mcl/estimate"]] == pytest.approx(played[:, 0].tolist())
    assert len(topics["/amcl/cloud"]) == len(topics["/mcl/cloud"]) == len(played)
    for name in ("mcl", "amcl"):
        track = np.loadtxt(tmp_path / f"out/tracks/{name}-0.tum")
        poses = [pose_of(one(decoded(data), 3))[:2] for _, _, data in topics[f"/{name}/estimate"]]
        np.testing.assert_allclose(poses, track[:, 1:3], atol=1e-6)
    ((_, schema, data),) = topics["/map"]
    grid = decoded(data)
    assert schema == "foxglove.Grid"
    rows, columns = floor_plan.occupancy.shape
    assert one(grid, 4) == columns
    colors = np.frombuffer(one(grid, 9), np.uint8).reshape(rows, columns, 4)
    assert ((colors[..., 0] < 100) == floor_plan.solid).all()
    assert one(decoded(one(grid, 5)), 1) == pytest.approx(0.05)


def segment_of(log, number=0):
    """A trial on a segment of a log in the hall."""
    world = {"log": str(log), "map": str(log.with_name("hall.yaml")), "segment": 1.0}
    world["every"] = "0.05m,2deg"
    return trial_of("dead-reckoning", number, scenario="log", world=world, lag=0)


def test_a_segment_of_a_log_has_the_times_of_its_own_records(hall, tmp_path):
    _, log = hall
    begun = set()
    for number in range(4):
        trial = segment_of(tmp_path / "lap.csv", number)
        shown_again([trial], tmp_path / f"{number}.mcap")
        shown = read(tmp_path / f"{number}.mcap")["/truth"]
        begun.add(shown[0][0])
        for at, _, data in shown:
            (pose,) = log.reference[log.times == at]
            assert pose_of(one(decoded(data), 3))[:2] == pytest.approx(pose[:2], abs=1e-9)
    assert len(begun) > 1  # else all would begin at one of some 20 records


def test_a_log_with_times_before_0_is_refused_and_leaves_no_file(hall, tmp_path):
    _, log = hall
    logs.write(replace(log, times=log.times - 1000.0), "early.csv")
    there = {path.name for path in tmp_path.iterdir()}
    with refused("is at -", "no time before 0 s"):
        shown_again([segment_of(tmp_path / "early.csv")], tmp_path / "a.mcap")
    assert {path.name for path in tmp_path.iterdir()} == there


def test_run_writes_the_same_numbers_with_and_without_it(tmp_path):
    assert exit_code(*RUN, "--out", tmp_path / "one") == 0
    named = ("--mcap", tmp_path / "a.mcap", "--out", tmp_path / "two")
    assert exit_code(*RUN, *named) == 0
    assert files(tmp_path / "one")["error.csv"] == files(tmp_path / "two")["error.csv"]
    truth = np.loadtxt(tmp_path / "two" / "trajectory_truth.tum")
    assert len(read(tmp_path / "a.mcap")["/mcl/cloud"]) == len(truth)


def test_a_run_that_is_stopped_leaves_no_file(tmp_path):
    stage = Stage.of(trial_of("mcl", 0, scenario="guided", params={"particles": 20}, lag=0))
    with showing(tmp_path / "a.mcap", {"mcl": stage.moments()}, stage) as rows:
        next(rows)
        assert len([*tmp_path.iterdir()]) == 1
    assert [*tmp_path.iterdir()] == []


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with refused("foxglove-sdk", "pip install 'deqmcl-gym[view]'"):
        mcap_file(tmp_path / "b.mcap")


@pytest.mark.parametrize(
    ("command", "name", "words"),
    [(RUN, "a.bag", ["--mcap", "a.bag", ".mcap"]), (REPLAY, "lap.mcap", ["exists already"])],
)
def test_a_command_refuses_it_and_writes_nothing(hall, tmp_path, command, name, words, capsys):
    (tmp_path / "lap.mcap").touch()
    assert exit_code(*command, "--mcap", name, "--out", "out") == 2
    lines = capsys.readouterr().err.splitlines()
    (said,) = [one for one in lines if not one.endswith("…")]
    assert [word for word in words if word not in said] == [], said
    assert not (tmp_path / "out").exists()
