"""``deqmcl replay`` on a log recorded here: its tables, against NumPy, and what it says."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from deqmcl_command import exit_code, lines, records, stored
from drives import recorded_in_a_hall
from report_cases import changed, finished

import benchmarks
from benchmarks.report.runs import middle_run, runs_frame, scores_by_localizer, worst_run
from benchmarks.report.tracks import run_words
from benchmarks.robots import replay_of
from benchmarks.robots import replaying as command
from benchmarks.robots.replaying import methods_of
from benchmarks.setup.logs import motion_noise
from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.episode import Step
from benchmarks.trials.scores import journey_scores
from benchmarks.trials.scoring import ErrorCurve, RecordedTrack, WholeRun
from benchmarks.trials.trace import TrackLog
from deqmcl_gym import logs
from deqmcl_gym.maps import GridMap, PolygonMap
from localizers import PointsBelief
from localizers.models.nav2_motion import unknown_motion
from localizers.template import MyLocalizer

COMMAND = ("lap.csv", "--map", "hall.yaml", "--every", "0.1m,5deg", "--set", "world.max_beams=20")
KNOWN = (*COMMAND, "--reference", "lap.tum", "--particles", "200", "--seeds", "3", "--jobs", "1")
BLIND = (*COMMAND, "--particles", "200", "--seeds", "1", "--jobs", "1")
BROKEN = """
class Broken:
    def __init__(self, robot): ...
    def reset(self, prior, plan, rng): raise OSError("no laser")
    def update(self, ranges, action, plan): ...
"""
ROOM = PolygonMap(((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)), unit="m")
SIDES = np.arange(1.0, 11.0)
TEMPLATE = "localizers.template:MyLocalizer"


def of_motion(params):
    return {f"assumed.motion.{name}": value for name, value in params.items()}


@pytest.fixture(scope="module")
def lap():
    """The hall, and the log of a shorter lap, of which less is localized."""
    return recorded_in_a_hall(steps=40)


def replay(*words, drawn=False):
    with pytest.MonkeyPatch.context() as patched:
        if not drawn:
            patched.setattr(command, "no_report", lambda: "it is left out")
        return exit_code("replay", *words)


def drive(n, interpolated=None):
    """A log of n records, 1 m and 1 s apart by odometry; the reference stays where it is."""
    at = np.outer(np.arange(float(n)), [1.0, 0.0, 0.0])
    scanner = logs.Scanner(angles=(0.0, 1.0), max_range=80.0)
    seen, still = np.full((n, 2), 9.0), np.zeros((n, 3))
    return logs.Log(scanner, at[:, 0], at, seen, still, interpolated=interpolated)


def kept_at(errors, cloud=(0.0,), judged=0, interpolated=None):
    """What is collected of a run whose belief is a cloud so far off at each record."""
    log = drive(len(errors), interpolated)
    kept = TrackLog(log, ROOM, Thresholds(far=1.0, lost=1.0), judged)
    for step, error in enumerate(errors):
        points = np.column_stack([error + np.array(cloud), *np.zeros((2, len(cloud)))])
        kept.see(Step(step, np.zeros(3), log.ranges[step], PointsBelief(points), 0.0))
    return kept


def record_of(errors, seed=0, **how):
    log = kept_at(errors, **how)
    run = log.track.journey()
    return changed(
        finished("mcl", seed, float(np.mean(errors)), scenario="replay", lag=0),
        unit="m",
        thresholds=Thresholds(far=1.0, lost=1.0),
        curves={0: ErrorCurve(0, list(errors))},
        steps_done=len(errors) - 1,
        scans_used=len(errors),
        journey=WholeRun.of(run, journey_scores(run, log.groups)),
        track=RecordedTrack.of(log),
    )


def runs_of(*errors):
    records = [record_of(own, seed) for seed, own in enumerate(errors)]
    return runs_frame({"mcl": records}, {"mcl": 0}, drive(len(errors[0])))


def test_coverage_and_nees_are_of_the_records_that_are_judged_and_stamps_leave_others_out():
    """All moments are about the best cluster, which is where the robot was said to be."""
    between = np.array([False, True, True, False, False])
    cloud = 0.01 * np.concatenate([SIDES, -SIDES])
    believed = kept_at([0.06] * 5, cloud).scores()  # 1 SD: χ² of two has 39 % below 1
    sd = np.sqrt(np.square(0.01 * SIDES).mean())
    assert [believed[f"coverage_{level}"] for level in (50, 80, 95)] == [1, 1, 1]
    assert believed["nees"] == pytest.approx((0.06 / sd) ** 2, rel=1e-2)
    assert math.isnan(believed["calibration_scale"])
    # fitted to the first record, which is off by 0.06, by none in between; judged by the last two
    published = kept_at([0.06, 0, 0, 0.06, -0.06], cloud, 2, between).scores()
    assert published["coverage_95"] == 1
    assert published["nees"] == pytest.approx(3, abs=2.1)
    assert published["calibration_scale"] != 1
    worse = kept_at([0.06, 9, 9, 0.6, -0.6], cloud, 2, between).scores()
    assert worse["nees"] == pytest.approx(100 * published["nees"], rel=1e-3)
    record = record_of([0.1, 0.9, 0.9, 0.2, 0.3], interpolated=between)
    (row,) = scores_by_localizer(runs_frame({"mcl": [record]}, {}, drive(5, between))).itertuples()
    assert row.position_median == pytest.approx(0.3)
    assert row.position_median_stamps == pytest.approx(0.2)
    assert (row.within_1m, row.within_05m) == (1, pytest.approx(0.6))


def tum(path):
    rows = [list(map(float, line.split())) for line in path.read_text().splitlines()]
    return {t: (x, y, 2 * math.atan2(qz, qw)) for t, x, y, _, _, _, qz, qw in rows}


@pytest.mark.parametrize(
    ("start", "beside"),
    [("reference", "dead-reckoning"), ("1.2,1,0", "dead-reckoning"), ("global", "mcl-map")],
)
def test_the_tables_are_those_of_numpy(recorded, start, beside):
    told = (*KNOWN, f"--start={start}", "--set", "assumed.scan.power=0.3")
    assert replay(*told, "--localizers", f"mcl,{beside}", "--out", "o", drawn=True) == 0
    results = {row["localizer"]: row for row in lines(Path("o"), "results.csv")}
    trials = lines(Path("o"), "trials.csv")
    assert [row["localizer"] for row in trials] == ["mcl"] * 3 + [beside] * 3
    log = logs.read("lap.csv").spaced(0.1, math.radians(5))
    way = [0.0]
    for forward, left, _ in log.increments.tolist():
        way.append(way[-1] + math.hypot(forward, left))
    reference = tum(recorded / "o/tracks/reference.tum")
    assert list(reference) == log.times.tolist()
    for name, row in results.items():
        positions, headings, metres, successes, shares = [], [], [], [], []
        for seed in range(3):
            estimate = tum(recorded / f"o/tracks/{name}-{seed}.tum")
            x, y, turn = np.transpose([np.subtract(estimate[t], reference[t]) for t in reference])
            positions.append(np.hypot(x, y))
            headings.append(np.abs(np.angle(np.exp(1j * turn))))
            good = (positions[-1] <= 1) & (headings[-1] <= math.radians(30))
            held = np.array([good[i] and good[i:].mean() >= 0.95 for i in range(len(good))])
            metres.append(way[held.argmax()] if held.any() else math.inf)
            successes.append(good[math.floor(0.75 * len(good)) :].mean() >= 0.95)
            shares.append(good.mean())
            (own,) = (r for r in trials if (r["localizer"], r["seed"]) == (name, str(seed)))
            assert float(own["position_median"]) == pytest.approx(np.median(positions[-1]))
            assert float(own["success_1m"]) == successes[-1]
            assert float(own["within_1m"]) == pytest.approx(shares[-1])
        expected = {
            "seeds": 3,
            "position_median": np.median(positions),
            "position_p95": np.quantile(positions, 0.95),
            "heading_median": np.median(headings),
            "success_1m": np.mean(successes),
            "metres_to_localize": np.median(metres),
            "within_1m": np.mean(shares),
        }
        assert {name: float(row[name]) for name in expected} == pytest.approx(expected)
    if start == "reference":
        assert float(results["mcl"]["position_median"]) < 0.1
    if start == "1.2,1,0":
        assert results["dead-reckoning"]["metres_to_localize"] == "inf"
    page = (recorded / "o/report.html").read_text()
    assert "http" not in page.replace("http://www.w3.org", "")


def test_more_runs_are_added_to_those_there_and_other_settings_are_refused(recorded, capsys):
    words = (*KNOWN, "--localizers", "dead-reckoning", "--out", "o")
    assert replay(*words, "--seeds", "1") == 0
    before = stored(recorded / "o")["trials.jsonl"]
    assert replay(*words, "--seeds", "2") == 0
    assert len(records(recorded / "o")) == 2
    assert stored(recorded / "o")["trials.jsonl"].startswith(before)
    assert [row["seed"] for row in lines(Path("o"), "trials.csv")] == ["0", "1"]
    assert replay(*words, "--seeds", "2", "--set", "world.radius=0.3") == 2
    assert "world.radius was not set and is 0.3" in capsys.readouterr().err
    assert exit_code("report", "o") == 2
    assert "give another --out" in capsys.readouterr().err
    assert exit_code("report", "o", "--out", "p") == 0
    assert "On the map" in (recorded / "p/report.html").read_text()


def test_without_a_reference_there_is_agreement_and_no_error(recorded, capsys):
    assert replay(*BLIND, "--start=2.3,1,0", "--localizers", "mcl", "--out", "o", drawn=True) == 0
    told = capsys.readouterr()
    assert "no error is known" in told.out
    assert "assumed, as there is no reference" in told.out
    assert "do not fit" not in told.err
    (row,) = lines(Path("o"), "results.csv")
    assert row["position_median"] == row["success_1m"] == row["metres_to_localize"] == ""
    assert float(row["agreement_03"]) > 0.9
    assert not (recorded / "o/tracks/reference.tum").exists()
    assert "no error is known" in (recorded / "o/report.html").read_text()


@pytest.mark.parametrize(("wrong", "known"), [("scale", True), ("floor", False)])
def test_a_map_that_does_not_fit_is_noticed(recorded, capsys, wrong, known):
    grid = GridMap.load("hall.yaml")
    cells, resolution = grid.occupancy, 0.1
    if wrong == "floor":
        cells, resolution = np.zeros((120, 160), np.int8), 0.05
        cells[[0, -1]] = cells[:, [0, -1]] = 100
    GridMap(occupancy=cells, resolution=resolution).save("hall.yaml")
    told = (*KNOWN, "--seeds", "1") if known else (*BLIND, "--start=2.3,1,0")
    assert replay(*told, "--localizers", "mcl", "--out", "o", drawn=True) == 0
    assert "Warning: log and map do not fit" in capsys.readouterr().err
    assert "Warning: log and map do not fit" in (recorded / "o/report.html").read_text()


def test_a_log_without_a_measurement_in_range_is_noticed(recorded, capsys):
    log = logs.read("lap.csv")
    mm = np.nan_to_num(log.ranges, posinf=np.nan) * 1000
    logs.write(logs.Log(log.scanner, log.times, log.odometry, mm, None, "m"), "lap.csv")
    assert replay(*KNOWN, "--localizers", "mcl", "--out", "o") == 0
    assert "Warning: no beam has a measurement" in capsys.readouterr().err


def test_what_the_reader_warns_of_is_also_said_before_a_refusal(recorded, capsys):
    texts = (recorded / "lap.csv").read_text().splitlines(keepends=True)
    (recorded / "lap.csv").write_text("".join([*texts, texts[-2]]))  # its time runs backwards
    assert replay(*KNOWN, "--start=40,1,0", "--out", "o") == 2
    warning, refusal = capsys.readouterr().err.splitlines()
    assert "backwards" in warning
    assert "no free space" in refusal


@pytest.mark.parametrize(
    ("kind", "part", "rest"),
    [
        ("differential", {"alpha3": 0.5}, {"alpha1": 0.1, "alpha2": 0.1, "alpha4": 0}),
        ("odometry", {"drive": 0.5}, {"turn": 0.1, "drift": 0}),
    ],
)
def test_motion_given_in_part_leaves_the_rest_as_it_would_be(recorded, kind, part, rest):
    (name,), chosen = part, {"kind": kind}
    origin = "of the log's odometry against its reference"
    replays = [
        replay_of("lap.csv", "hall.yaml", settings=of_motion(given), reference="lap.tum")
        for given in (chosen, chosen | part, chosen | part | rest)
    ]
    estimated, partly, whole = (replay.motion for replay in replays)
    assert estimated == motion_noise(replays[0].log, kind)
    assert partly == replace(estimated, **part)
    assert vars(whole) == vars(whole) | part | rest
    assert replays[1].noise.startswith(f"{name} given; the rest {origin}")
    assert replays[2].noise == "given"
    table = {"assumed.motion": chosen | part}
    as_table = replay_of("lap.csv", "hall.yaml", settings=table, reference="lap.tum")
    assert (as_table.motion, as_table.noise) == (partly, replays[1].noise)
    unknown = replay_of("lap.csv", "hall.yaml", settings=of_motion(chosen), start="1.2,1,0")
    assert unknown.motion == unknown_motion(kind, "m")
    assert unknown.noise == "assumed, as there is no reference"


def test_a_plug_in_that_fails_ends_with_3_and_the_others_are_kept(recorded, capsys):
    (recorded / "broken.py").write_text(BROKEN)
    assert replay(*KNOWN, "--localizers", "mcl,broken.py:Broken", "--out", "o", drawn=True) == 3
    told = capsys.readouterr()
    assert "3 of 6 trials failed" in told.err
    assert "no laser" in told.err
    mine = {row["localizer"]: row for row in lines(Path("o"), "results.csv")}
    assert mine["mcl"]["failed"] == "0"
    assert mine["broken.py:Broken"]["failed"] == "3"
    assert float(mine["mcl"]["success_1m"]) == 1
    assert "no laser" in (recorded / "o/report.html").read_text()


def test_the_verdict_stands_first_and_how_many_runs_would_confirm_a_difference(recorded, capsys):
    assert replay(*KNOWN, "--localizers", "mcl,amcl,dead-reckoning", "--out", "o", drawn=True) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert told.startswith("3 runs each cannot decide: give --seeds 9 or more.")
    rows = lines(Path("o"), "results.csv")
    errors = {row["localizer"]: float(row["position_median"]) for row in rows}
    ranked = ", ".join(f"{name} {errors[name]:.3f} m" for name in sorted(errors, key=errors.get))
    assert f"Position error, median over all records: {ranked}. Worst run: " in told
    # 3 runs cannot give p < 0.05 in so many tests: 2 × 2⁻³ is 0.25 alone
    assert "runs needed" in told
    assert "about" in told
    page = (recorded / "o/report.html").read_text().replace("\u00a0", " ")
    assert page.index("3 runs each cannot") < page.index("<table")
    assert "the least way driven after which 95 % of the records are within 1 m" in page
    assert " worlds" not in page
    assert "difference of e" not in page
    assert ranked in page


def test_the_worst_run_is_the_one_with_the_fewest_records_within_1_m_and_says_where_it_was_lost():
    right, wrong = [0.1] * 8, [0.05, 3, 0.05, 0.05, 0.05, 4, 5, 6]
    runs = runs_of(right, wrong, right)
    worst, median = worst_run(runs), middle_run(runs)
    assert (worst.seed, median.seed) == (1, 2)
    assert worst.track.lost == (5, 5.0)
    assert "lost after 5.0 m, 5.0 s" in run_words(worst)
    assert "50 % of its records" in run_words(worst)
    assert "its largest error is 6.00 m" in run_words(worst)
    found_again = runs_of([0.1, 3, 3, 0.1, 0.1, 2] + [0.1] * 34).iloc[0]
    assert "localized to the end; 92 % of its records" in run_words(found_again)
    assert "the longest stretch beyond from 1.0 to 2.0 m" in run_words(found_again)
    assert median.track.lost is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--start=2.1,1.6,0",), "no free space"),
        (("--start=2.3,1",), "must be reference, global"),
        (("--start", "-1,0,0"), "write --start=VALUE if it begins with -"),
        (("--set", "world.reading.scanner=front"), "write it into the file"),
        (("--start=2.3,1,90",), "radians"),
        (("--every", "often"), "0.2m,5deg"),
        (("--set", "assumed.motion.kind=omny"), "did you mean 'omni'?"),
        (("--set", "assumed.motion.drive=1"), "unknown assumption 'motion.drive'"),
        (("--set", "assumed.scan.power=0"), "scan.power"),
        (("--set", "world.log=x.csv"), "world.log is set beside the log that is given"),
        (("--set", "world.segment=5"), "here the whole log is played"),
        (("--seeds", "0"), "--seeds"),
        (("--set", "trials=3"), "unknown name of a setting on a log 'trials'"),
        (("--set", "params.mlc.beta=3"), "did you mean 'mcl'"),
        (("--set", "params.amcl.pf_err=-1"), "pf_err"),
        (("--every", "1m", "--set", "world.every=1m"), "--every is given, and world.every set"),
        (("--set", "world.changed_walls.seed=nan"), "--set world.changed_walls.seed is nan"),
        (("--start", "near=40,40,1"), "AnnulusRegion"),
        (("--reference", "far.tum"), "leaves the map"),
        (("--reference", "late.tum"), "same clock"),
        (("--reference", "wall.tum"), "on the map: give --start=x,y,θ."),
        (("--node", "amcl"), "--node is given without --nav2"),
    ],
)
def test_bad_input_is_refused_in_a_sentence_and_nothing_is_written(recorded, capsys, words, said):
    reference = logs.read_tum("lap.tum")
    logs.Trajectory(reference.times, reference.poses + 50).write("far.tum")
    poses = reference.poses.copy()
    poses[0] = (2.1, 1.6, 0.0)
    logs.Trajectory(reference.times, poses).write("wall.tum")
    logs.Trajectory(reference.times + 1e4, reference.poses).write("late.tum")
    assert replay(*KNOWN, *words, "--out", "o") == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert said in told
    assert not (recorded / "o").exists()


@pytest.mark.parametrize("start", ["room=0.5,0.5,2,0.5,2,2,0.5,2", "near=1.2,1,0.8", "prior.toml"])
def test_a_start_may_be_what_a_person_knows(recorded, capsys, start):
    (recorded / "prior.toml").write_text(
        "[prior]\nkind = 'places'\n"
        "[[prior.places]]\nkind = 'uniform'\nnear = [1.2, 1.0]\nwithin = 0.5\n"
        "[[prior.places]]\nkind = 'gaussian'\nmean = [3.0, 2.4, 3.0]\nsd_position = 0.1\n"
    )
    words = ("--particles", "50", "--seeds", "1", "--start", start, "--localizers", "mcl-map")
    assert replay(*KNOWN, *words, "--out", "o") == 0
    said = {"p": "prior.kind places, prior.places (", "n": "prior.near (1.2, 1.0)"}
    assert said.get(start[0], "prior.polygon ((0.5, 0.5), (") in capsys.readouterr().out


def test_a_localizer_has_its_own_parameters_before_the_number_of_particles():
    own = {"mcl-map": {"particles": 9}}
    methods = methods_of(["mcl", "mcl-map"], 70, own)
    assert [dict(method.params) for method in methods] == [{"particles": 70}, {"particles": 9}]
    (bounded,) = methods_of(["amcl"], 70, {})
    assert dict(bounded.params) == {"max_particles": 70, "min_particles": 70}


@pytest.mark.parametrize(
    ("words", "fits"),
    [
        (["--localizers", "amcl"], False),
        (["--localizers", "amcl,dead-reckoning"], True),
        (["--localizers", "amcl", "--set", "params.amcl.laser_model_type=robot"], True),
    ],
)
def test_the_power_is_fitted_only_where_a_localizer_uses_it(recorded, monkeypatch, words, fits):
    fitted = []
    place = "benchmarks.robots.calibration.with_fitted_power"
    monkeypatch.setattr(place, lambda replay: fitted.append(1) or replay)
    assert replay(*KNOWN, "--seeds", "1", *words, "--out", "o") == 0
    assert bool(fitted) is fits


def test_a_sparse_reference_is_counted_by_what_is_known_of_it(recorded, capsys):
    whole = logs.read_tum("lap.tum")
    logs.Trajectory(whole.times[::3], whole.poses[::3]).write("sparse.tum")
    told = (*KNOWN, "--every", "0.001m", "--localizers", "dead-reckoning")
    assert replay(*told, "--reference", "sparse.tum", "--out", "o") == 0
    said = " ".join(capsys.readouterr().out.split())
    played = logs.read("lap.csv").spaced(0.001, math.inf).times
    own = int(np.isin(played, whole.times[::3]).sum())
    between = int((played <= whole.times[::3][-1]).sum()) - own
    assert f"{own} of {played.size} records have a pose within" in said
    assert f"for {between} it is interpolated along the odometry" in said
    assert f"{played.size - own - between} without one do not count" in said
    (row,) = lines(Path("o"), "results.csv")
    assert float(row["position_median_stamps"]) > 0


def test_poses_are_those_of_the_robot_wherever_its_lidar_is(recorded, capsys):
    # seen from its centre, which is no matter here
    logs.write(logs.read("lap.csv", mounting=(0.3, 0.1, 0.0)), "ahead.csv")
    x, y, heading = logs.read_tum("lap.tum").poses[0].tolist()
    words = ("ahead.csv", *KNOWN[1:], "--localizers", "dead-reckoning")
    assert replay(*words, "--out", "o") == 0
    given, written = tum(recorded / "lap.tum"), tum(recorded / "o/tracks/reference.tum")
    assert len(written) > 20
    for time, pose in written.items():
        assert pose == pytest.approx(given[time], abs=1e-12)
    said = " ".join(capsys.readouterr().out.split())
    assert f"around ({x:.2f}, {y:.2f}, {heading:.2f} rad)" in said
    assert replay(*words, f"--start={x!r},{y!r},{heading!r}", "--out", "p") == 0
    for seed in range(3):
        one, two = (recorded / out / f"tracks/dead-reckoning-{seed}.tum" for out in ("o", "p"))
        assert one.read_bytes() == two.read_bytes()  # the same start, in whichever words


def test_odometry_that_moves_sideways_is_told_unless_the_motion_model_knows_it(recorded):
    log = logs.read("lap.csv")
    strafing = log.odometry.copy()
    strafing[:, 1] += 0.05 * np.arange(len(log))  # m a record, whatever the heading
    logs.write(replace(log, odometry=strafing), "strafing.csv")
    plain, omni = (
        replay_of("strafing.csv", "hall.yaml", settings=settings, reference="lap.tum").sideways
        for settings in ({}, of_motion({"kind": "omni"}))
    )
    assert "sideways: for a robot that can move so, add --set assumed.motion" in plain
    assert omni is None


def test_a_notebook_replays_a_log_with_its_own_class_and_gets_the_commands_tables(recorded):
    class Mine(MyLocalizer):
        """A localizer of a notebook."""

    how = {"reference": "lap.tum", "seeds": 1, "settings": {"world.every": "0.2m,5deg"}}
    played = benchmarks.replay("lap.csv", "hall.yaml", localizers=Mine, jobs=1, **how)
    words = ("lap.csv", "--map", "hall.yaml", "--every", "0.2m,5deg", "--reference", "lap.tum")
    assert replay(*words, "--localizers", TEMPLATE, "--seeds", "1", "--out", "o") == 0
    (row,) = lines(Path("o"), "results.csv")
    assert list(played.table["localizer"]) == ["Mine"]
    for name in ("position_median", "success_1m", "agreement_01"):
        assert played.table[name][0] == float(row[name])
    assert len(played.trials) == 1
    assert str(played).startswith(repr(played))
    assert "Written to" not in str(played)
    assert "position_median" not in played._repr_html_()  # in words, as on the page
