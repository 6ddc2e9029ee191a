"""``deqmcl score``: somebody else's estimates have the numbers that our own would have.

Their APE and RPE are evo's. ``--fail-if``: which limits are broken, and by what rows.
"""

import math

import numpy as np
import pandas as pd
import pytest
from deqmcl_command import exit_code, lines
from drives import recorded_in_a_hall, write_lap
from refusals import refused
from scipy.stats import chi2

from benchmarks.report.runs import LimitError, limits_of, within
from benchmarks.robots import replay_of
from benchmarks.robots.estimates import played_by_replay
from benchmarks.trials.tracks import absolute, calibration_of_gaussians, relative_errors
from deqmcl_gym import logs
from deqmcl_gym.logs.motion import composed, relative

REPLAY = ("replay", "lap.csv", "--map", "hall.yaml", "--reference", "lap.tum", "--jobs", "1")
REPLAY += ("--localizers", "mcl", "--particles", "100", "--seeds", "2")
REPLAY += ("--set", "world.max_beams=20")
WHOLE = ("--reference", "lap.tum", "--log", "lap.csv", "--map", "hall.yaml")
COVARIANCES = "time,x,y,heading,var_x,cov_xy,cov_x_heading,var_y,cov_y_heading,var_heading"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    at = tmp_path_factory.mktemp("score")
    write_lap(recorded_in_a_hall(steps=40), at)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(at)
        assert exit_code(*REPLAY, "--out", "mcl") == 0
    return at


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def table(folder, name):
    return {row["localizer"]: row for row in lines(folder, name)}


def test_our_own_tracks_have_the_numbers_of_the_replay_but_for_time_and_beliefs(here, tmp_path):
    tracks = [f"mcl/tracks/mcl-{seed}.tum" for seed in range(2)]
    assert exit_code("score", *tracks, "--beside", "mcl", "--out", tmp_path / "s") == 0
    ours = {f"mcl-{row['seed']}": row for row in lines(here / "mcl")}
    theirs = table(tmp_path / "s", "trials.csv")
    unknown = {"localizer", "seed", "ms_per_step", "nees", "log_score"}
    unknown |= {f"coverage_{p}" for p in (50, 80, 95)}
    unknown |= {name for name in ours["mcl-0"] if name.startswith("calibration_")}
    for label, row in ours.items():
        known = row.keys() - unknown
        assert {name: theirs[label][name] for name in known} == {name: row[name] for name in known}
        assert {theirs[label][name] for name in unknown - {"localizer", "seed"}} == {""}
    assert table(tmp_path / "s", "results.csv")["mcl"]["seeds"] == "2"


def test_between_its_poses_an_estimate_is_carried_on_by_the_odometry(here):
    log = logs.read("lap.csv", reference="lap.tum")
    rng = np.random.default_rng(0)
    at = np.arange(0, len(log), 7)
    estimate = logs.Trajectory(log.times[at] + 1e-4, rng.uniform(1, 2, (at.size, 3)))
    played = played_by_replay("lap.csv", "lap.tum", {}, None, "0m,0deg")
    track = played.track(estimate)
    told = (log.times >= estimate.times[0]) & (log.times <= estimate.times[-1])
    np.testing.assert_array_equal(np.isfinite(track.best).all(axis=1), told)
    x, y, heading = log.odometry.T
    for time, best in zip(log.times[told], track.best[told], strict=True):
        last = np.flatnonzero(estimate.times <= time)[-1]
        then = [np.interp(estimate.times[last], log.times, row) for row in
                (x, y, np.unwrap(heading))]  # fmt: skip
        now = log.odometry[log.times == time]
        moved = relative(np.array([then]), now)
        expected = composed(estimate.poses[[last]], moved)[0]
        assert best[:2] == pytest.approx(expected[:2], abs=1e-9)
        assert math.remainder(best[2] - expected[2], 2 * math.pi) == pytest.approx(0, abs=1e-9)


def test_a_log_is_scored_at_the_records_that_replay_plays(here, tmp_path):
    whole, late = logs.read_tum("lap.tum"), str(tmp_path / "late.tum")
    logs.Trajectory(whole.times[5:], whole.poses[5:]).write(late)
    told = {"reference": late, "settings": {"world.every": "0.1m,5deg"}}
    played = replay_of("lap.csv", "hall.yaml", **told).log
    for floor_plan in ("hall.yaml", None):
        scored = played_by_replay("lap.csv", late, {}, floor_plan, "0.1m,5deg").log
        for name in ("times", "odometry", "ranges", "reference"):
            np.testing.assert_array_equal(getattr(scored, name), getattr(played, name))
        assert scored.times[0] == whole.times[5]


def test_without_a_log_errors_are_those_at_the_estimates_own_times(here, tmp_path):
    reference = logs.Trajectory([0.0, 10.0], [[0, 0, 3.0], [1, 2, -3.0]])  # across ±π, 0.28 rad
    reference.write(tmp_path / "reference.tum")
    times = np.array([-1.0, 0.0, 2.5, 10.0, 11.0])
    poses = np.array([[9, 9, 0], [0.3, 0, 3.0], [0.25, 0.5, 3.0], [1, 2.4, -3.0], [9, 9, 0]])
    logs.Trajectory(times, poses).write(tmp_path / "theirs.tum")
    words = ("score", tmp_path / "theirs.tum", "--reference", tmp_path / "reference.tum")
    assert exit_code(*words, "--out", tmp_path / "s") == 0  # 2.2 m apart: at its own times only
    row = table(tmp_path / "s", "trials.csv")["theirs"]
    assert float(row["position_median"]) == pytest.approx((0.3 + 0.4) / 2)
    logs.Trajectory([0.0, 10.0], [[0, 0, 3.0], [0.5, 1, -3.0]]).write(tmp_path / "reference.tum")
    assert exit_code(*words, "--out", tmp_path / "s") == 0
    row = table(tmp_path / "s", "trials.csv")["theirs"]
    off = [0.3, math.hypot(0.125, 0.25), math.hypot(0.5, 1.4)]
    assert float(row["position_median"]) == pytest.approx(sorted(off)[1], rel=1e-6)
    assert float(row["position_median_stamps"]) == pytest.approx(np.median([off[0], off[2]]))


def test_gaussians_are_calibrated_by_the_chi_squared_distribution():
    rng = np.random.default_rng(1)
    n = 4000
    roots = rng.normal(0, 0.3, (n, 3, 3))
    spread = roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(3)
    poses = rng.uniform(-3, 3, (n, 3))
    truth = poses + (np.linalg.cholesky(spread) @ rng.normal(size=(n, 3, 1)))[:, :, 0]
    off = truth - poses
    off[:, 2] = (off[:, 2] + math.pi) % (2 * math.pi) - math.pi
    rank, nees, log_score = calibration_of_gaussians(off, spread, "m").T
    floored = spread + np.diag([4e-6, 4e-6, 1e-6])  # (0.1 px)², 1e-6
    by_numpy = np.einsum("ni,nij,nj->n", off, np.linalg.inv(floored), off)
    np.testing.assert_allclose(nees, by_numpy, rtol=1e-9)
    turns = 3 * math.log(2 * math.pi)
    logs = (by_numpy + np.linalg.slogdet(floored)[1] + turns) / 2
    np.testing.assert_allclose(log_score, logs, rtol=1e-9, atol=1e-9)
    flat = np.einsum("ni,nij,nj->n", off[:, :2], np.linalg.inv(floored[:, :2, :2]), off[:, :2])
    np.testing.assert_allclose(rank, chi2.cdf(flat, 2), rtol=1e-9, atol=1e-12)
    # NEES has mean 3 and variance 6, a share p of ranks variance p(1-p): 4 sigma, once in 16,000
    assert abs(nees.mean() - 3) < 4 * math.sqrt(6 / n)
    for p in (0.5, 0.8, 0.95):
        assert abs((rank <= p).mean() - p) < 4 * math.sqrt(p * (1 - p) / n)


def write_estimate(path, times, poses, spread):
    upper = np.asarray(spread)[np.triu_indices(3)].tolist()
    rows = [(t, *pose, *upper) for t, pose in zip(times, np.asarray(poses).tolist(), strict=True)]
    path.write_text("\n".join([COVARIANCES, *(",".join(map(repr, row)) for row in rows)]))
    return path


def test_a_covariance_gives_the_columns_of_calibration(here, tmp_path):
    reference = logs.read_tum("lap.tum")
    off, spread = reference.poses + np.array([0.2, 0, 0]), np.diag([0.04, 0.04, 0.01])
    slam = write_estimate(tmp_path / "theirs.csv", reference.times.tolist(), off, spread)
    assert exit_code("score", f"slam={slam}", *WHOLE, "--out", tmp_path / "s") == 0
    row = table(tmp_path / "s", "results.csv")["slam"]
    # one SD off: χ² = 1, which 39 % of draws are below
    assert float(row["nees"]) == pytest.approx(1, rel=1e-3)
    # ½ (1 + log det 2πP), P of 0.2 m, 0.2 m and 0.1 rad
    density = math.log(0.2 * 0.2 * 0.1) + 1.5 * math.log(2 * math.pi)
    assert float(row["log_score"]) == pytest.approx(0.5 + density, abs=1e-3)
    assert [float(row[f"coverage_{p}"]) for p in (50, 80, 95)] == [1, 1, 1]
    assert float(row["position_median"]) == pytest.approx(0.2)
    assert 0 < float(row["agreement_03"]) <= 1


def test_beside_what_a_stack_published_stands_what_a_calibration_of_it_would_have(tmp_path, capsys):
    """Fitted to the first 30 %, judged by the rest: a tenth of the SD that it should have."""
    n, rng, spread = 1000, np.random.default_rng(5), np.diag([0.01, 0.01, 0.0025])
    reference = logs.Trajectory(np.arange(float(n)), np.zeros((n, 3)))
    reference.write(tmp_path / "reference.tum")
    poses = rng.normal(size=(n, 3)) * np.sqrt(np.diag(spread))
    slam = write_estimate(tmp_path / "slam.csv", range(n), poses, spread / 100)
    words = ("score", slam, "--reference", tmp_path / "reference.tum", "--out", tmp_path / "s")
    assert exit_code(*words) == 0
    rows = table(tmp_path / "s", "results.csv")
    assert list(rows) == ["slam", "slam, calibrated"]
    plain, calibrated = rows.values()
    assert float(plain["nees"]) == pytest.approx(300, rel=0.2)
    assert plain["calibration_scale"] == ""
    assert plain["position_median"] == calibrated["position_median"]
    # 3 numbers of 900 deviates move NEES by 4 %, its mean over 700 records has SD 0.09
    assert float(calibrated["nees"]) == pytest.approx(3, abs=0.6)
    sd = math.sqrt(0.95 * 0.05 / (0.7 * n))
    assert float(calibrated["coverage_95"]) == pytest.approx(0.95, abs=4 * sd + 0.02)
    assert "slam, calibrated: Calibration(scale=" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("lap.tum",), "give --reference, --log or --beside"),
        (("lap.tum", "--beside", "mcl", "--reference", "lap.tum"), "--reference is given with"),
        (("lap.tum", "--log", "lap.csv"), "has no reference"),
        (("late.tum", "--reference", "lap.tum"), "no record has a reference pose"),
        (("late.tum", *WHOLE), "with the same clock"),
        (("lap.tum", "lap.tum", "--reference", "lap.tum"), "two estimates are called lap"),
        (("mcl=lap.tum", "--beside", "mcl"), "mcl is a localizer of the replay"),
        (("lap.tum:/amcl_pose", "--reference", "lap.tum"), "no topic /amcl_pose"),
        (("lap.tum", "--reference", "lap.tum", "--fail-if", "p95 > 1"), "unknown column"),
    ],
)
def test_what_cannot_be_scored_is_refused_and_nothing_written(here, tmp_path, capsys, words, said):
    reference = logs.read_tum("lap.tum")
    logs.Trajectory(reference.times + 1e4, reference.poses).write("late.tum")
    assert exit_code("score", *words, "--out", tmp_path / "s") == 2
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert said in sentence
    assert sentence.endswith(".")
    assert not (tmp_path / "s").exists()


def test_limits_end_the_command_with_exit_code_4_after_all_is_written(here, tmp_path, capsys):
    words = ("score", "lap.tum", "--reference", "lap.tum", "--out", tmp_path / "s")
    assert exit_code(*words, "--fail-if", "position_p95 > 0.01") == 0
    assert exit_code(*words, "--fail-if", "nees > 5", "--fail-if", "lap.position_p95 >= 0") == 4
    said = capsys.readouterr()
    assert "lap has an unknown value (nees > 5); lap has 0 (lap.position_p95 >= 0)." in said.err
    assert f"Written to {tmp_path / 's'}" in said.out


def test_records_that_an_estimate_misses_are_told(here, tmp_path, capsys):
    reference = logs.read_tum("lap.tum")
    half = reference.times.size // 2
    logs.Trajectory(reference.times[:half], reference.poses[:half]).write(tmp_path / "half.tum")
    assert exit_code("score", tmp_path / "half.tum", *WHOLE, "--out", tmp_path / "s") == 0
    assert "half covers" in capsys.readouterr().err


TABLE = pd.DataFrame(
    {
        "localizer": ["mcl", "amcl (a)", "amcl (b.2)"],
        "position_p95": [0.1, 0.2, math.nan],
        "metres_to_localize": [3.0, math.inf, 2.0],
        "position_median_diff": [math.nan, 0.02, -0.01],
    }
)


@pytest.mark.parametrize(
    ("words", "rows"),
    [
        ("position_p95 > 0.2", ["amcl (b.2) has an unknown value (position_p95 > 0.2)"]),
        ("amcl (a).position_p95 >= .2", ["amcl (a) has 0.2"]),
        ("mcl.position_p95<0.05", []),
        ("amcl (b.2).position_p95 < 9", ["amcl (b.2) has an unknown value"]),
        ("metres_to_localize > 1e3", ["amcl (a) has inf"]),
        ("position_median_diff > 0.01", ["amcl (a) has 0.02"]),
        ("mcl.position_median_diff > 0.01", ["mcl has an unknown value"]),
    ],
)
def test_a_row_beyond_a_limit_or_unknown_is_told_after_the_output(capsys, words, rows):
    limits = [words, "mcl.position_p95 > 5"]
    if not rows:
        assert within("text", TABLE, limits, "mcl") == "text"
        return
    with pytest.raises(LimitError) as raised:
        within("text", TABLE, limits, "mcl")
    told = str(raised.value).removeprefix("beyond --fail-if: ").split("; ")
    assert [one.startswith(row) for one, row in zip(told, rows, strict=True)] == [True] * len(rows)
    assert capsys.readouterr().out == "text\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("position_p59 > 0.2", "did you mean 'position_p95'?"),
        ("position_p95 > much", "'position_p95 > much'"),
        ("position_p95 = 0.2", "one of >, <, >=, <="),
        ("acml.position_p95 > 0.2", "did you mean 'amcl'?"),
    ],
)
def test_what_is_no_limit_is_refused(words, told):
    with refused(told):
        limits_of([words], ["mcl", "amcl"])


def tracks(seed, n=120):
    rng = np.random.default_rng(seed)
    reference = np.cumsum(rng.normal(0.1, 0.5, (n, 3)), axis=0)
    return reference + rng.normal(0, 0.3, (n, 3)), reference


@pytest.mark.parametrize("part", ["translation", "rotation"])
def test_errors_are_those_of_evo(tmp_path, part):
    pytest.importorskip("evo")
    from evo.core.metrics import APE, RPE, PoseRelation
    from evo.tools.file_interface import read_tum_trajectory_file

    estimate, reference = tracks(0)
    times = 1e9 + 0.1 * np.arange(len(estimate))
    read = []
    for name, poses in (("reference", reference), ("estimate", estimate)):
        logs.Trajectory(times, poses).write(tmp_path / name)
        read.append(read_tum_trajectory_file(str(tmp_path / name)))
    relation = {"translation": "translation_part", "rotation": "rotation_angle_rad"}[part]
    for metric, ours in ((APE, absolute), (RPE, relative_errors)):
        theirs = metric(pose_relation=PoseRelation[relation])
        theirs.process_data(tuple(read))
        found = getattr(ours(estimate, reference), part)
        np.testing.assert_allclose(found, theirs.error, rtol=0, atol=1e-6)


def test_poses_without_a_reference_count_for_nothing():
    estimate, reference = tracks(0)
    reference[::3] = np.nan
    known = np.isfinite(reference[:, 0])
    whole = absolute(estimate, reference)
    assert whole.rmse == absolute(estimate[known], reference[known]).rmse
    assert whole.translation.size == known.sum()
