"""``deqmcl replay`` on a log recorded here: its tables, against plain loops, and what it says."""

import csv
import math
import statistics
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hall import recorded_in_a_hall

from benchmarks.cli import main
from benchmarks.replay.playing import Track
from benchmarks.replay.scoring import Played, Row
from benchmarks.replay.setting import Told, setting_of
from benchmarks.replay.tables import results_table
from benchmarks.replay.verdict import differences, family_of
from benchmarks.replay.words import told
from benchmarks.setup.motion_noise import motion_noise
from deqmcl_gym import logs
from deqmcl_gym.maps import GridMap
from localizers.models.nav2_motion import DifferentialMotion, unknown_motion

COMMAND = ("lap.csv", "--map", "hall.yaml", "--every", "0.1m,5deg", "--max-beams", "20")
KNOWN = (*COMMAND, "--reference", "lap.tum", "--particles", "200", "--seeds", "3", "--jobs", "1")
BLIND = (*COMMAND, "--particles", "200", "--seeds", "1", "--jobs", "1")
BROKEN = """
class Broken:
    def __init__(self, robot): ...
    def reset(self, prior, plan, rng): raise OSError("no laser")
    def update(self, ranges, action, plan): ...
"""


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """The current folder, with a hall, a log without poses, and its reference."""
    monkeypatch.chdir(tmp_path)
    hall, log = recorded_in_a_hall(steps=40)
    hall.save("hall.yaml")
    logs.Trajectory(log.times, log.reference).write("lap.tum")
    logs.write(logs.Log(log.scanner, log.times, log.odometry, log.ranges, None, "m"), "lap.csv")
    return tmp_path


def replay(*words):
    """Run the command; its exit code."""
    try:
        return main(["replay", *map(str, words)])
    except SystemExit as end:
        return end.code


def played_at(errors, seed=0, interpolated=None):
    """A run that is so far off at each record, 1 m and 1 s apart."""
    n = len(errors)
    poses, counted = np.zeros((n, 3)), np.arange(float(n))
    off = poses + np.outer(errors, [1.0, 0.0, 0.0])
    track = Track(
        times=counted, way=counted, means=off, best=off, truth=poses, ranks=np.full(n, 0.6),
        nees=np.full(n, 4.0), seconds=np.ones(n), unit="m",
    )  # fmt: skip
    log = SimpleNamespace(unit="m", interpolated=interpolated)
    run = SimpleNamespace(setting=SimpleNamespace(log=log, judged=0), seed=seed)
    return Played(run=run, track=track, agreement=(0.0, 0.0))


def scored(seed, error):
    return played_at([error] * 4, seed)


def test_coverage_and_nees_are_those_of_the_records_and_errors_at_stamps_leave_others_out():
    between = np.array([False, True, True, False, False])
    scores = played_at([0.1, 0.9, 0.9, 0.2, 0.3], interpolated=between).scores
    assert [scores[f"coverage_{level}"] for level in (50, 80, 95)] == [0, 1, 1]
    assert scores["nees"] == 4
    assert scores["position_median"] == 0.3
    assert scores["position_median_stamps"] == 0.2
    assert (scores["within_1m"], scores["within_05m"]) == (1, pytest.approx(0.6))


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def tum(path):
    """Poses x, y, θ by time, as the text says."""
    rows = [list(map(float, line.split())) for line in path.read_text().splitlines()]
    return {t: (x, y, 2 * math.atan2(qz, qw)) for t, x, y, _, _, _, qz, qw in rows}


@pytest.mark.parametrize(
    ("start", "beside"),
    [("reference", "dead-reckoning"), ("1.2,1,0", "dead-reckoning"), ("global", "mcl-map")],
)
def test_the_tables_are_those_of_plain_loops(recorded, start, beside):
    told = (*KNOWN, f"--start={start}", "--scan", "power=0.3")
    assert replay(*told, "--localizers", f"mcl,{beside}", "--out", "o") == 0
    results = {row["localizer"]: row for row in table("o/results.csv")}
    trials = table("o/trials.csv")
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
            position, heading, good = [], [], []
            for time, (x, y, angle) in reference.items():
                ex, ey, theirs = estimate[time]
                position.append(math.hypot(ex - x, ey - y))
                heading.append(abs(math.remainder(theirs - angle, 2 * math.pi)))
                good.append(position[-1] <= 1 and heading[-1] <= math.radians(30))
            from_here = [all(good[i:]) for i in range(len(good))]
            metres.append(way[from_here.index(True)] if any(from_here) else math.inf)
            successes.append(all(good[math.floor(0.75 * len(good)) :]))
            positions += position
            headings += heading
            (own,) = (r for r in trials if (r["localizer"], r["seed"]) == (name, str(seed)))
            assert float(own["position_median"]) == pytest.approx(statistics.median(position))
            rms = math.sqrt(sum(error**2 for error in position) / len(position))
            assert float(own["ape_rmse"]) == pytest.approx(rms)
            assert float(own["success_1m"]) == successes[-1]
            assert float(own["within_1m"]) == pytest.approx(sum(good) / len(good))
            shares.append(float(own["within_1m"]))
        assert row["seeds"] == "3"
        assert float(row["position_median"]) == pytest.approx(statistics.median(positions))
        assert float(row["position_p95"]) == pytest.approx(np.quantile(positions, 0.95))
        assert float(row["heading_median"]) == pytest.approx(statistics.median(headings))
        assert float(row["success_1m"]) == pytest.approx(sum(successes) / 3)
        assert float(row["metres_to_localize"]) == pytest.approx(statistics.median(metres))
        assert float(row["within_1m"]) == pytest.approx(sum(shares) / 3)
        assert float(row["ms_per_step"]) > 0
    if start == "reference":
        assert float(results["mcl"]["position_median"]) < 0.1
    if start == "1.2,1,0":
        assert results["dead-reckoning"]["metres_to_localize"] == "inf"
    page = (recorded / "o/report.html").read_text()
    worst = page.count(": worst run</h4>")  # beside the median one, if it is another
    assert page.count("<svg") == 5 + worst
    assert worst + page.count(": median and worst run</h4>") == 2
    assert "http" not in page.replace("http://www.w3.org", "")


def test_the_numbers_do_not_depend_on_who_runs_beside_or_where(recorded):
    assert replay(*KNOWN, "--localizers", "mcl,amcl", "--out", "one") == 0
    assert replay(*KNOWN, "--localizers", "amcl", "--jobs", "2", "--out", "two") == 0
    for seed in range(3):
        name = f"tracks/amcl-{seed}.tum"
        assert (recorded / "one" / name).read_bytes() == (recorded / "two" / name).read_bytes()


def test_without_a_reference_there_is_agreement_and_no_error(recorded, capsys):
    assert replay(*BLIND, "--start=2.3,1,0", "--localizers", "mcl", "--out", "o") == 0
    told = capsys.readouterr()
    assert "no error is known" in told.out
    assert "assumed, as there is no reference" in told.out
    assert "do not fit" not in told.err
    (row,) = table("o/results.csv")
    assert row["position_median"] == row["success_1m"] == row["metres_to_localize"] == ""
    assert float(row["agreement_03"]) > 0.9
    assert not (recorded / "o/tracks/reference.tum").exists()
    assert "no error is known" in (recorded / "o/report.html").read_text()


@pytest.mark.parametrize("wrong", ["scale", "floor"])
@pytest.mark.parametrize("known", [True, False])
def test_a_map_that_does_not_fit_is_noticed(recorded, capsys, wrong, known):
    grid = GridMap.load("hall.yaml")
    cells, resolution = grid.occupancy, 0.1
    if wrong == "floor":
        cells, resolution = np.zeros((120, 160), np.int8), 0.05
        cells[[0, -1]] = cells[:, [0, -1]] = 100
    GridMap(occupancy=cells, resolution=resolution).save("hall.yaml")
    told = (*KNOWN, "--seeds", "1") if known else (*BLIND, "--start=2.3,1,0")
    assert replay(*told, "--localizers", "mcl", "--out", "o") == 0
    assert "Warning: log and map do not fit" in capsys.readouterr().err
    assert "Warning: log and map do not fit" in (recorded / "o/report.html").read_text()


@pytest.mark.parametrize("told", [KNOWN, (*BLIND, "--start=2.3,1,0")])
def test_a_log_without_a_measurement_in_range_is_noticed(recorded, capsys, told):
    log = logs.read("lap.csv")
    mm = np.nan_to_num(log.ranges, posinf=np.nan) * 1000
    logs.write(logs.Log(log.scanner, log.times, log.odometry, mm, None, "m"), "lap.csv")
    assert replay(*told, "--localizers", "mcl", "--out", "o") == 0
    assert "Warning: no beam has a measurement" in capsys.readouterr().err


def test_what_the_reader_warns_of_is_also_said_before_a_refusal(recorded, capsys):
    lines = (recorded / "lap.csv").read_text().splitlines(keepends=True)
    (recorded / "lap.csv").write_text("".join([*lines, lines[-2]]))  # its time runs backwards
    assert replay(*KNOWN, "--start=40,1,0", "--out", "o") == 2
    warning, refusal = capsys.readouterr().err.splitlines()
    assert "Warning: " in warning
    assert "backwards" in warning
    assert "no free space" in refusal


@pytest.mark.parametrize(
    ("kind", "part", "rest"),
    [
        ("differential", "alpha3=0.5", "alpha1=0.1,alpha2=0.1,alpha4=0"),
        ("omni", "alpha5=0.5", "alpha1=0.1,alpha2=0.1,alpha3=0.1,alpha4=0"),
        ("odometry", "drive=0.5", "turn=0.1,drift=0"),
    ],
)
def test_motion_given_in_part_leaves_the_rest_as_it_would_be(recorded, kind, part, rest):
    log = logs.referenced(logs.read("lap.csv"), "lap.tum")
    blind = replace(log, reference=None, interpolated=None)
    (name, value), chosen = part.split("="), f"kind={kind}"
    origin = "of the log's odometry against its reference"
    settings = [
        setting_of(log, "hall.yaml", Told(motion=",".join(words)))
        for words in ((chosen,), (chosen, part), (chosen, part, rest))
    ]
    estimated, partly, whole = (setting.motion for setting in settings)
    assert estimated == motion_noise(settings[0].log, kind)
    assert partly == replace(estimated, **{name: float(value)})
    words = dict(one.split("=") for one in f"{part},{rest}".split(","))
    assert vars(whole) == vars(whole) | {key: float(word) for key, word in words.items()}
    said = [setting.noise for setting in settings]
    assert said[0].startswith(origin)
    assert said[1].startswith(f"{name} given; the rest {origin}")
    assert said[2] == "given"
    unknown = setting_of(blind, "hall.yaml", Told(motion=chosen, start="1.2,1,0"))
    assert unknown.motion == unknown_motion(kind, "m")
    assert unknown.noise == "assumed, as there is no reference"


def test_the_motion_of_a_replay_is_differential_unless_another_kind_is_told(recorded):
    told = Told(start="1.2,1,0")
    assert setting_of(logs.read("lap.csv"), "hall.yaml", told).motion == DifferentialMotion()


def test_a_plug_in_that_fails_ends_with_3_and_the_others_are_kept(recorded, capsys):
    (recorded / "broken.py").write_text(BROKEN)
    assert replay(*KNOWN, "--localizers", "mcl,broken.py:Broken", "--out", "o") == 3
    told = capsys.readouterr()
    assert "3 of 6 runs failed" in told.err
    assert "no laser" in told.err
    mine = {row["localizer"]: row for row in table("o/results.csv")}
    assert mine["mcl"]["failed"] == "0"
    assert mine["broken.py:Broken"]["failed"] == "3"
    assert float(mine["mcl"]["success_1m"]) == 1
    assert "no laser" in (recorded / "o/report.html").read_text()


def test_lost_runs_are_counted_among_those_that_ended():
    here, poses, seconds = np.zeros((3, 3)), np.full((3, 3), 50.0), np.ones(3)
    track = Track(
        times=np.arange(3.0), way=np.arange(3.0), means=poses, best=poses, truth=here,
        ranks=seconds, nees=seconds, seconds=seconds, unit="m",
    )  # fmt: skip
    log = SimpleNamespace(unit="m", interpolated=None)
    run = SimpleNamespace(setting=SimpleNamespace(log=log, judged=0), seed=0)
    played = [Played(run=run, track=track, agreement=(0.0, 0.0))] * 2
    row = Row(localizer="mcl", played=played, failed_seeds=(2, 3))
    told = results_table([row], referenced=True)
    cells = dict(zip(told.header, told.lines[0], strict=True))
    assert cells["lost"] == "2 of 2"
    assert cells["localized to the end"] == "0 of 4"


def test_the_verdict_stands_first_and_says_how_many_runs_would_confirm_a_difference(
    recorded, capsys
):
    assert replay(*KNOWN, "--localizers", "mcl,amcl,dead-reckoning", "--out", "o") == 0
    told = " ".join(capsys.readouterr().out.split())
    results = {row["localizer"]: row for row in table("o/results.csv")}
    best = min(results, key=lambda name: (-float(results[name]["success_1m"]),
                                          float(results[name]["position_median"])))  # fmt: skip
    assert told.startswith(f"{best} is ahead: localized to the end in 3 of 3 runs")
    # 3 runs of 4 tests cannot give p < 0.05: 4 × 2 × 2⁻³ = 1
    assert "p = 1" not in told
    assert "would need about" in told
    page = (recorded / "o/report.html").read_text()
    assert page.index("is ahead: localized") < page.index("<table")
    assert "would need about" in page


def test_differences_that_many_runs_show_are_confirmed_and_their_intervals_say_the_same():
    rng = np.random.default_rng(0)
    played = {
        name: [scored(seed, error) for seed, error in enumerate(rng.normal(middle, 0.01, 12))]
        for name, middle in (("near", 0.1), ("far", 0.2), ("same", 0.1))
    }
    rows = [Row(localizer=name, played=runs) for name, runs in played.items()]
    apart = {row.localizer: differences(row, rows[0], family_of(rows))[1] for row in rows[1:]}
    assert apart["far"].p == pytest.approx(4 * 2 / 2**12)  # all on one side, 4 tests
    assert apart["far"].confirmed
    assert apart["far"].value.low > 0
    assert apart["far"].value.mean == pytest.approx(0.1, abs=0.01)
    assert not apart["same"].confirmed
    assert apart["same"].value.low < 0 < apart["same"].value.high
    assert apart["same"].doubt.startswith("not confirmed")


def test_the_worst_run_is_the_one_with_the_fewest_records_within_1_m_and_says_where_it_was_lost():
    right, wrong = played_at([0.1] * 8), played_at([0.05, 3, 0.05, 0.05, 0.05, 4, 5, 6])
    row = Row(localizer="mcl", played=[right, wrong, right])
    assert row.worst is wrong
    assert row.middle is right
    assert wrong.lost == (5, 5.0)
    assert "lost after 5.0 m, 5.0 s" in told(wrong)
    assert "50% of its records" in told(wrong)
    assert "the largest error is 6.00 m" in told(wrong)
    assert right.lost is None


def test_a_plug_in_that_hangs_is_ended_in_time(recorded, capsys):
    (recorded / "slow.py").write_text(
        BROKEN.replace('raise OSError("no laser")', "all(iter(lambda: True, 0))")
    )
    words = ("--localizers", "slow.py:Broken", "--timeout", "2", "--out", "o")
    assert replay(*BLIND, "--start=1.2,1,0", *words) == 3
    assert "1 of 1 runs failed" in (told := capsys.readouterr().err)
    assert "no result within 2 s" in told


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--start=2.1,1.6,0",), "no free space"),
        (("--start=40,1,0",), "no free space"),
        (("--start=2.3,1",), "must be reference, global"),
        (("--start", ""), "must be reference, global"),
        (("--start", "-1,0,0"), "write --start=VALUE if it begins with -"),
        (("--read", "scanner=front"), "write it into the file"),
        (("--start=2.3,1,90",), "radians"),
        (("--every", "often"), "0.2m,5deg"),
        (("--motion", "kind=omny"), "did you mean 'omni'?"),
        (("--motion", "drive=1"), "unknown name in --motion 'drive': allowed values: alpha1"),
        (("--motion", "kind=odometry,dive=1"), "did you mean 'drive'?"),
        (("--motion", "kind=omni,still=1"), "'still'"),
        (("--motion", "alpha1=much"), "must be a number"),
        (("--motion", "alpha1=-1"), "alpha1 is -1"),
        (("--scan", "power=0"), "scan.power"),
        (("--scan", "kind=sonar"), "beam model"),
        (("--max-beams", "0"), "max_beams"),
        (("--particles", "0"), "--particles"),
        (("--seeds", "0"), "--seeds"),
        (("--radius", "-0.1"), "--radius"),
        (("--param", "mcl"), "NAME.KEY=VALUE"),
        (("--param", "mlc.beta=3"), "did you mean 'mcl'"),
        (("--param", "amcl.max_particle=3"), "did you mean 'max_particles'"),
        (("--param", "amcl.pf_err=-1"), "pf_err"),
        (("--param", "amcl.pf_z=much"), "pf_z"),
        (("--param", "mcl.particles=9", "--param", "mcl.particles=9"), "twice"),
        (("--jobs", "0"), "--jobs"),
        (("--localizers", "mlc"), "'mcl'"),
        (("--localizers", "mcl,mcl"), "named twice"),
        (("--localizers", ","), "names none"),
        (("--reference", "far.tum"), "leaves the map"),
        (("--reference", "late.tum"), "same clock"),
        (("--map", "lost.yaml"), "lost.yaml"),
    ],
)
def test_bad_input_is_refused_in_a_sentence_and_nothing_is_written(recorded, capsys, words, said):
    reference = logs.read_tum("lap.tum")
    logs.Trajectory(reference.times, reference.poses + 50).write("far.tum")
    logs.Trajectory(reference.times + 1e4, reference.poses).write("late.tum")
    assert replay(*KNOWN, *words, "--out", "o") == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert said in told
    assert not (recorded / "o").exists()


def test_no_reference_and_no_start_is_refused(recorded, capsys):
    assert replay(*BLIND, "--out", "o") == 2
    assert "--start global" in capsys.readouterr().err


def test_a_folder_that_holds_other_files_is_refused(recorded, capsys):
    (recorded / "lost+found.txt").write_text("mine")
    assert replay(*KNOWN, "--out", recorded) == 2
    assert "none of this command's" in capsys.readouterr().err
    assert not (recorded / "results.csv").exists()


def test_params_reach_their_localizer_and_no_other(recorded):
    words = (*KNOWN, "--seeds", "1", "--localizers", "mcl,mcl-map")
    assert replay(*words, "--out", "plain") == 0
    given = ("--param", "mcl-map.particles=37", "--param", "mcl-map.start_draws=3")
    assert replay(*words, *given, "--out", "own") == 0
    for name, same in (("mcl", True), ("mcl-map", False)):
        one, two = (recorded / out / f"tracks/{name}-0.tum" for out in ("plain", "own"))
        assert (one.read_bytes() == two.read_bytes()) == same
    assert "mcl-map.particles=37" in (recorded / "own/report.html").read_text()


def test_a_sparse_reference_is_counted_by_what_is_known_of_it(recorded, capsys):
    whole = logs.read_tum("lap.tum")
    logs.Trajectory(whole.times[::3], whole.poses[::3]).write("sparse.tum")
    told = (*KNOWN, "--every", "0.001m", "--localizers", "dead-reckoning")
    assert replay(*told, "--reference", "sparse.tum", "--out", "o") == 0
    said = " ".join(capsys.readouterr().out.split())
    played = logs.read("lap.csv").spaced(0.001, math.inf).times
    own = int(np.isin(played, whole.times[::3]).sum())
    between = int((played <= whole.times[::3][-1]).sum()) - own
    assert f"{own} of {played.size} records have a pose of their own time" in said
    assert f"for {between} it is interpolated along the odometry" in said
    assert f"{played.size - own - between} without one do not count" in said
    assert "Every second pose, left out" in said
    (row,) = table("o/results.csv")
    assert float(row["position_median_stamps"]) > 0


def test_poses_are_those_of_the_robot_wherever_its_lidar_is(recorded, capsys):
    log = logs.read(
        "lap.csv", mounting=(0.3, 0.1, 0.0)
    )  # seen from its centre, which is no matter here
    logs.write(log, "ahead.csv")
    x, y, heading = logs.read_tum("lap.tum").poses[0].tolist()
    words = ("ahead.csv", *KNOWN[1:], "--localizers", "dead-reckoning")
    assert replay(*words, "--out", "o") == 0
    given, written = tum(recorded / "lap.tum"), tum(recorded / "o/tracks/reference.tum")
    assert len(written) > 20
    for time, pose in written.items():
        assert pose == pytest.approx(given[time], abs=1e-12)
    said = " ".join(capsys.readouterr().out.split())
    assert f"around ({x:.2f}, {y:.2f}, {heading:.2f} rad)" in said
    assert "mounted at (0.3, 0.1) m" in said
    assert replay(*words, f"--start={x!r},{y!r},{heading!r}", "--out", "p") == 0
    assert f"around ({x:.2f}, {y:.2f}, {heading:.2f} rad)" in capsys.readouterr().out
    for seed in range(3):
        one, two = (recorded / out / f"tracks/dead-reckoning-{seed}.tum" for out in ("o", "p"))
        assert one.read_bytes() == two.read_bytes()  # the same start, in whichever words


def test_odometry_that_moves_sideways_is_told_unless_the_motion_model_knows_it(recorded, capsys):
    log = logs.read("lap.csv")
    strafing = log.odometry.copy()
    strafing[:, 1] += 0.05 * np.arange(len(log))  # m a record, whatever the heading
    logs.write(replace(log, odometry=strafing), "strafing.csv")
    words = ("strafing.csv", *KNOWN[1:], "--localizers", "dead-reckoning")
    assert replay(*words, "--out", "o") == 0
    assert "of odometry are sideways: for a robot that can move so, add --motion kind=omni" in (
        " ".join(capsys.readouterr().err.split())
    )
    assert replay(*words, "--motion", "kind=omni", "--out", "p") == 0
    assert replay("lap.csv", *words[1:], "--out", "q") == 0
    assert "sideways" not in capsys.readouterr().err
