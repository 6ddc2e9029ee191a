"""``deqmcl basin``: starts that are wrong, and how many runs are localized from there."""

import csv
import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import exit_code, files, lose, stored
from hall import recorded_in_a_hall, write_lap
from refusals import refused

from benchmarks.replay.basin import MOSTLY, Question
from benchmarks.setup.names import scenario
from benchmarks.trials.collecting import WholeRun
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.maps import GridMap
from localizers import GaussianPrior

ON_LOG = ("basin", "lap.csv", "--map", "hall.yaml", "--reference", "lap.tum", "--segment", "2")
ASKED = ("--distances", "0,0.4,1.2", "--angles", "0,90", "--trials", "3", "--every", "0.1m,5deg")
FEW = (*ON_LOG, *ASKED, "--within", "1m", "--set", "assumed.scan.power=0.3")


@pytest.fixture(scope="module")
def lap():
    return recorded_in_a_hall(steps=60)


@pytest.fixture
def recorded(lap, tmp_path, monkeypatch):
    """The current folder, with the hall, the log without poses, and its reference."""
    monkeypatch.chdir(tmp_path)
    write_lap(lap, tmp_path)
    return tmp_path


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def begun(distance, angle, number=0, **how):
    """The stage of a trial in an office, just begun, with such an error of the start."""
    assumed = {"prior.kind": "displaced", "prior.distance": distance, "prior.angle": angle}
    trial = Trial(
        **{"localizer": "mcl", **how}, scenario="driving-blind", assumed=assumed, params=(), lag=0,
        seed=3, trial=number,
    )  # fmt: skip
    stage = Stage.of(trial)
    stage.env.reset(seed=trial.world_seed)
    return stage


def test_a_displaced_mean_is_off_by_the_distance_and_the_angle_and_stands_in_free_space():
    directions, sides = [], []
    for number in range(8):
        near, far = begun(0.5, 0.7, number), begun(2.0, 0.7, number)
        right = np.array(near.room.expected_start)
        assert begun(0.0, 0.0, number).prior().mean == pytest.approx(tuple(right), abs=1e-12)
        off = np.array([stage.prior().mean for stage in (near, far)]) - right
        np.testing.assert_allclose(np.hypot(*off[:, :2].T), [0.5, 2.0], rtol=1e-12)
        np.testing.assert_allclose(np.abs(off[:, 2]), 0.7, rtol=1e-12)
        for stage in (near, far):
            at = np.array([stage.prior().mean])
            assert stage.room.floor_plan.free(at, stage.room.radius).all()
        assert stage.prior() == begun(2.0, 0.7, number, localizer="deq-mcl").prior()
        directions.append(math.atan2(off[0, 1], off[0, 0]))
        sides.append(off[0, 2] > 0)
    assert len({round(one, 6) for one in directions}) == 8
    assert {True, False} == set(sides)  # all on one side: 1 in 128, and the seed is fixed


def test_a_displaced_prior_keeps_its_spread_and_is_scored_as_of_the_lost():
    stage = begun(1.0, 0.5)
    base = scenario("driving-blind").prior
    expected = GaussianPrior(
        mean=(0, 0, 0), sd_position=base.sd_position, sd_heading=base.sd_heading
    )
    assert replace(stage.prior(), mean=(0, 0, 0)) == expected
    assert "lost" in [group.name for group in stage.groups]


BAD_PRIORS = [
    ({"prior.distance": -1.0}, ["prior.distance", "-1"]),
    ({"prior.angle": 4.0}, ["prior.angle", "4"]),
    ({"prior.distance": 900.0}, ["prior.distance", "900", "nothing is free"]),
    ({"prior.distanse": 1.0}, ["'prior.distanse'", "did you mean 'prior.distance'?"]),
]


@pytest.mark.parametrize(("assumed", "words"), BAD_PRIORS)
def test_a_displacement_that_cannot_be_is_refused(assumed, words):
    trial = Trial(
        scenario="driving-blind", assumed={"prior.kind": "displaced", **assumed},
        localizer="mcl", params=(), lag=0, seed=0, trial=0,
    )  # fmt: skip
    with refused(*words):
        Stage.of(trial).check()


def test_a_direction_is_not_drawn_from_nothing():
    stage = begun(1.0, 0.5)
    with refused("drawn", "rng"):
        stage.scenario.prior_in(stage.room)


def test_a_run_is_localized_from_where_it_stays_near_to_its_end():
    rng = np.random.default_rng(0)
    asked = Question.told("0,1", "0", "0.5m,15deg", "1m,30deg", "3m")
    by_steps = replace(asked, within=6.0, unit="steps")
    seen = []
    for _ in range(200):
        n = int(rng.integers(1, 12))
        off = np.where(rng.random(n) < 0.3, 1.5, 0.2).tolist()
        turned = np.where(rng.random(n) < 0.2, 0.6, 0.1).tolist()
        way = np.cumsum(rng.random(n)).tolist()
        run = WholeRun(scores={}, curves={"way": way, "distance": off, "angle": turned})
        near = [d <= 1 and a <= math.radians(30) for d, a in zip(off, turned, strict=True)]
        never = math.inf, math.inf
        expected = next(((way[i], i) for i in range(n) if all(near[i:])), never)
        assert asked.reached(run) == expected
        assert asked.counts(expected) == (expected[0] <= 3)
        assert by_steps.counts(expected) == (expected[1] <= 6)
        seen.append(expected)
    assert never in seen
    assert len(set(seen)) > 20


def test_dead_reckoning_is_localized_just_where_its_start_is_near_enough(recorded):
    exact = ("--spread", "0m,0deg", "--localizers", "dead-reckoning", "--jobs", "1")
    assert exit_code(*FEW, *exact, "--localized", "0.8m,30deg", "--out", "out") == 0
    shares = {(row["distance_m"], row["angle_deg"]): row["share"] for row in table("out/basin.csv")}
    # odometry drifts by less than 0.1 m in 2 m: an error of the start stays what it is
    assert shares == {
        (d, a): str(float(d in ("0.0", "0.4") and a == "0.0"))
        for d in ("0.0", "0.4", "1.2")
        for a in ("0.0", "90.0")
    }


def test_its_table_is_that_of_the_trials_on_any_number_of_workers_and_resumed(recorded, capsys):
    particles = ("--particles", "100", "--localizers", "mcl-map,mcl")
    assert exit_code(*FEW, *particles, "--jobs", "1", "--out", "one") == 0
    said = capsys.readouterr().out
    assert "mcl-map: localized in" in said
    shutil.copytree("one", "two")
    trials = (recorded / "two" / "trials.jsonl").read_text().splitlines()
    lose(recorded / "two", *range(0, len(trials), 2))
    for name in ("basin.csv", "basin.md", "basin.png"):
        (recorded / "two" / name).unlink()
    assert exit_code(*FEW, *particles, "--jobs", "2", "--out", "two") == 0
    for name in ("basin.csv", "basin.md", "basin.png"):
        assert files(recorded / "one")[name] == files(recorded / "two")[name], name
    counts = {}
    for kept in map(json.loads, trials):
        curves, prior = kept["record"]["journey"]["curves"], kept["trial"]["assumed"]
        near = [
            d <= 1 and a <= math.radians(30)
            for d, a in zip(curves["distance"], curves["angle"], strict=True)
        ]
        first = next((i for i in range(len(near)) if all(near[i:])), None)
        place = kept["trial"]["localizer"], prior["prior.distance"], prior["prior.angle"]
        own = counts.setdefault(place, [])
        own.append(first is not None and curves["way"][first] <= 1)
    rows = table("one/basin.csv")
    assert len(rows) == len(counts) == 2 * 3 * 2
    for row in rows:
        place = (
            row["localizer"], float(row["distance_m"]), math.radians(float(row["angle_deg"]))
        )  # fmt: skip
        assert (int(row["runs"]), int(row["localized"])) == (3, sum(counts[place])), place
        shown = f"{100 * float(row['share']):.0f} %"
        bold = f"**{shown}**" if float(row["share"]) >= MOSTLY else shown
        assert f"| {bold} " in (recorded / "one/basin.md").read_text()


def test_another_question_of_the_same_runs_runs_nothing(recorded, capsys):
    known = (*FEW, "--localizers", "dead-reckoning", "--jobs", "1", "--out", "out")
    assert exit_code(*known) == 0
    before = stored(recorded / "out")
    capsys.readouterr()
    assert exit_code(*known, "--within", "5steps", "--localized", "9m,180deg") == 0
    assert "running" not in capsys.readouterr().err
    assert stored(recorded / "out") == before
    assert {row["share"] for row in table("out/basin.csv")} == {"1.0"}


@pytest.mark.parametrize("wrong", [False, True])
def test_a_map_that_does_not_fit_the_log_is_noticed(recorded, capsys, wrong):
    if wrong:
        GridMap(occupancy=GridMap.load("hall.yaml").occupancy, resolution=0.1).save("hall.yaml")
    right = ("--distances", "0", "--angles", "0", "--trials", "1")
    words = (*FEW, *right, "--localizers", "dead-reckoning", "--jobs", "1", "--out", "out")
    assert exit_code(*words) == 0
    said = "Warning: log and map do not fit: seen from the reference poses"
    assert (said in capsys.readouterr().err) == wrong


BAD = [
    ((), ["LOG", "--scenario"]),
    (("lap.csv",), ["lap.csv", "--map"]),
    (("lap.csv", "--scenario", "lost"), ["LOG", "--scenario"]),
    (("--scenario", "lost", "--map", "hall.yaml"), ["--map", "--scenario"]),
    (("--scenario", "lst"), ["'lst'", "did you mean 'lost'?"]),
    ((*ON_LOG[1:6], "--segment", "0"), ["--segment", "0"]),
    ((*ON_LOG[1:6], "--segment", "900"), ["900"]),
    ((*ON_LOG[1:6], "--distances", "0,x"), ["--distances", "'0,x'"]),
    ((*ON_LOG[1:6], "--distances", "1,0"), ["--distances", "ascending"]),
    ((*ON_LOG[1:6], "--distances=-1,0"), ["--distances", "-1"]),
    ((*ON_LOG[1:6], "--angles", "0,270"), ["--angles", "270", "180"]),
    ((*ON_LOG[1:6], "--spread", "0.5m"), ["--spread", "'0.5m'", "0.5m,15deg"]),
    ((*ON_LOG[1:6], "--localized", "1"), ["--localized", "'1'"]),
    ((*ON_LOG[1:6], "--within", "10"), ["--within", "'10'", "50steps"]),
    ((*ON_LOG[1:6], "--within", "0m"), ["--within", "'0m'"]),
    ((*ON_LOG[1:6], "--trials", "0"), ["--trials", "0"]),
    ((*ON_LOG[1:6], "--localizers", "mcl,mcl"), ["twice", "mcl"]),
    ((*ON_LOG[1:6], "--localizers", "mlc"), ["'mlc'", "mcl"]),
    (ON_LOG[1:], ["--segment is 2 m", "longer than --within, 10 m"]),
    ((*ON_LOG[1:], "--within", "2m"), ["--segment is 2 m", "longer than --within, 2 m"]),
    ((*ON_LOG[1:6], "--localizers", ","), ["no localizer is named", "mcl-map"]),
    ((*FEW[1:], "--distances", "0,90"), ["prior.distance", "90", "nothing is free"]),
    (ON_LOG[1:4], ["lap.csv", "reference"]),
]


@pytest.mark.parametrize(("words", "named"), BAD)
def test_bad_words_are_refused_in_one_sentence_and_nothing_is_written(
    recorded, words, named, capsys
):
    assert exit_code("basin", *words, "--out", "out") == 2
    lines = capsys.readouterr().err.splitlines()
    (said,) = [one for one in lines if not one.endswith("…") and "Warning" not in one]
    assert [word for word in named if word not in said] == [], said
    assert not (recorded / "out").exists()
