"""``deqmcl smooth``: a reference from the log itself, by backward simulation on the map."""

import numpy as np
import pytest
from deqmcl_command import exit_code, lines

import benchmarks
from benchmarks.robots.smoothing import covariances, mean_poses
from benchmarks.trials.tracks import absolute
from deqmcl_gym import logs

SETTINGS = {"world.max_beams": 20, "world.every": "0.05m,3deg"}
COMMAND = ("smooth", "lap.csv", "--map", "hall.yaml", "--particles", "200", "--seeds", "2")
COMMAND += ("--set", "world.max_beams=20", "--every", "0.05m,3deg")


def start(log):
    return ",".join(map(str, log.reference[0].tolist()))


def smoothed_of(log, particles=200, seeds=2):
    how = {"start": start(log), "settings": SETTINGS, "particles": particles, "seeds": seeds}
    return benchmarks.smooth("lap.csv", "hall.yaml", **how)


def test_it_is_nearer_to_the_truth_than_the_filter_and_knows_how_near(recorded, lap):
    _, log = lap
    smoothed = smoothed_of(log, particles=300, seeds=3)
    truth = log.reference[np.searchsorted(log.times, smoothed.log.times)]
    error = absolute(smoothed.poses, truth)
    replayed = benchmarks.replay(
        "lap.csv", "hall.yaml", start=start(log), localizers=["mcl"], seeds=3, particles=300,
        settings={**SETTINGS, "assumed.scan.power": 0.3}, jobs=1,
    )  # fmt: skip
    filtered = [absolute(track.best, truth).rmse for track in replayed.runs["track"]]
    assert error.rmse < np.mean(filtered)
    variances = np.diagonal(smoothed.covariances, axis1=1, axis2=2)[:, :2]
    off = np.abs(smoothed.poses - truth)[:, :2] / np.sqrt(variances)
    assert (off < 3).mean() > 0.9
    assert "may serve as a reference" in smoothed.verdict
    assert not smoothed.doubtful.any()


def test_the_command_writes_what_score_and_replay_read(recorded, lap):
    _, log = lap
    assert exit_code(*COMMAND, f"--start={start(log)}", "--out", "smooth") == 0
    scoring = ("score", "smooth/smoothed.csv", "--reference", "lap.tum", "--out", "scored")
    assert exit_code(*scoring) == 0
    (row,) = lines(recorded / "scored", "results.csv")
    assert float(row["position_median"]) < 0.1
    assert float(row["nees"]) < 6
    logs.read("lap.csv", reference="smooth/smoothed.tum")
    first = (recorded / "smooth" / "smoothed.csv").read_bytes()
    assert exit_code(*COMMAND, f"--start={start(log)}", "--out", "smooth") == 0
    assert (recorded / "smooth" / "smoothed.csv").read_bytes() == first


def test_it_may_start_at_the_reference_of_the_log(recorded, lap):
    logs.write(lap[1], "lap.csv")
    assert exit_code(*COMMAND, "--start", "reference", "--out", "smooth") == 0


def test_a_stretch_that_the_map_does_not_explain_is_named_and_left_out(recorded, lap):
    _, log = lap
    ranges = log.ranges.copy()
    ranges[30:45] = np.random.default_rng(0).permuted(ranges[30:45], axis=1)
    logs.write(logs.Log(log.scanner, log.times, log.odometry, ranges, None, "m"), "lap.csv")
    smoothed = smoothed_of(log)
    smoothed.write("smooth")
    assert "Left out of smoothed.tum" in smoothed.verdict
    kept = logs.read_tum("smooth/smoothed.tum").times
    assert not np.isin(log.times[33:42], kept).any()
    assert np.isin(smoothed.log.times, kept).mean() > 0.6


def frozen(log):
    return np.broadcast_to(log.ranges[0], log.ranges.shape)


def shuffled(log):
    return np.random.default_rng(0).permuted(log.ranges, axis=1)


@pytest.mark.parametrize(("scans", "words"), [(frozen, "the odometry"), (shuffled, "doubtful")])
def test_poses_that_the_log_speaks_against_are_no_reference(recorded, lap, scans, words):
    _, log = lap
    logs.write(logs.Log(log.scanner, log.times, log.odometry, scans(log), None, "m"), "lap.csv")
    smoothed = smoothed_of(log)
    assert words in smoothed.objection
    assert {path.name for path in smoothed.write("smooth")} == {"smoothed.csv"}


def test_means_and_covariances_of_headings_go_round_the_circle():
    rng = np.random.default_rng(0)
    paths = np.array([1.0, 2.0, 3.1]) + 0.2 * rng.standard_normal((20_000, 4, 3))
    paths[..., 2] = np.angle(np.exp(1j * paths[..., 2]))
    mean = mean_poses(paths)
    np.testing.assert_allclose(mean, np.full((4, 3), [1.0, 2.0, 3.1]), atol=0.01)
    expected = np.stack([np.eye(3) * 0.04] * 4)
    np.testing.assert_allclose(covariances(paths, mean), expected, atol=0.002)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "--start"),
        (("--start=0.0,0.0,0",), "no free space"),
        (("--start", "global", "--seeds", "0"), "--seeds is 0"),
        (("--start", "global", "--set", "params.particles=3"), "name of a setting of smooth"),
    ],
)
def test_what_is_wrong_is_refused_in_a_sentence(recorded, capsys, words, sentence):
    assert exit_code(*COMMAND, *words, "--out", "smooth") == 2
    assert sentence in capsys.readouterr().err
    assert not (recorded / "smooth").exists()
