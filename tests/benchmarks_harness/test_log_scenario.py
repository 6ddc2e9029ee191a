"""Scenario ``log``: a segment of a recorded log is a world, the same for all methods."""

import math
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import exit_code, lines
from hall import recorded_in_a_hall, write_lap
from refusals import refused

from benchmarks.setup.logs import motion_noise
from benchmarks.setup.names import scenario, scenario_digest
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials.stage import Stage, key_of
from localizers.models.nav2_motion import unknown_motion

WORLD = """
log = "data/lap.csv"
map = "data/hall.yaml"
reference = "data/lap.tum"
segment = 3.0
every = "0.05m,3deg"
max_beams = 15
"""
SCENARIO = f"""
base = "log"
[env]
{WORLD}
"""
SWEEP = f"""
scenario = "log"
trials = 3
localizers = ["mcl", "dead-reckoning"]
[world]
{WORLD}
[params]
particles = 100
"""


@pytest.fixture(scope="module")
def drive():
    """A hall, and what a robot saw in it."""
    return recorded_in_a_hall(steps=60)


@pytest.fixture
def folder(drive, tmp_path, monkeypatch):
    """A folder with sweep and scenario, their data below it; nobody stands in it."""
    home = tmp_path / "home"
    (home / "data").mkdir(parents=True)
    write_lap(drive, home / "data")
    (home / "hall.toml").write_text(SCENARIO)
    (home / "sweep.toml").write_text(SWEEP)
    monkeypatch.chdir(tmp_path)
    return home


def trials(folder, text=SWEEP):
    (folder / "sweep.toml").write_text(text)
    return read_sweep(folder / "sweep.toml").distinct()


def test_methods_see_the_same_segment_and_worlds_begin_anywhere(folder):
    seen = [list(Stage.of(trial).moments()) for trial in trials(folder)]
    mcl, other = seen[:3], seen[3:]
    for ours, theirs in zip(mcl, other, strict=True):
        for one, two in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(one.ranges, two.ranges)
            np.testing.assert_array_equal(one.truth, two.truth)
            np.testing.assert_array_equal(one.action, two.action)
    assert len({tuple(moments[0].truth) for moments in mcl}) == 3


def test_the_prior_is_around_the_reference_where_the_segment_begins(folder):
    for trial in trials(folder)[:2]:
        start = next(iter(Stage.of(trial).moments()))
        poses, _ = start.belief.points()
        assert np.hypot(*(poses.mean(axis=0) - start.truth)[:2]) < 5 * 0.2 / math.sqrt(100)
    ours = scenario(str(folder / "hall.toml"))
    room = ours.room()
    room.reset(seed=4)
    assert ours.prior_in(room).mean == room.record.reference
    anywhere = ours.changed(assumed={"prior.kind": "uniform"}).prior_in(room)
    assert anywhere.mean is None


@pytest.mark.parametrize("kind", [None, "odometry", "omni"])
def test_the_noise_is_that_of_the_log_unless_it_is_given(folder, kind):
    chosen = {} if kind is None else {"motion.kind": kind}
    name, value = ("drive", 0.5) if kind == "odometry" else ("alpha3", 0.5)
    assumed = unknown_motion(kind or "differential", "m")
    ours = scenario(str(folder / "hall.toml"))
    room = ours.room()
    found = ours.changed(assumed=chosen).robot_model(room).motion
    assert found == motion_noise(room.log, kind or "differential")
    told = ours.changed(assumed=chosen | {f"motion.{name}": value})
    assert told.robot_model(room).motion == replace(assumed, **{name: value})


@pytest.mark.parametrize("power", [1.0, 0.05])
def test_on_a_log_beta_is_tempered_as_scans_are_and_in_rooms_and_offices_it_is_not(folder, power):
    for name, factor in ((str(folder / "hall.toml"), power), ("paper", 1.0), ("lost", 1.0)):
        ours = scenario(name).changed(assumed={"scan.power": power}).in_building(0)
        assert ours.robot_model(ours.room()).beta == 10.0 * factor


def test_a_result_is_named_by_what_is_in_the_files_of_its_world(folder):
    keys = [key_of(trials(folder)[0])]
    digests = [scenario_digest(str(folder / "hall.toml"))]
    for name in ("lap.csv", "lap.tum", "hall.pgm", "hall.yaml"):
        file = folder / "data" / name
        file.write_bytes(file.read_bytes() + b"\n")
        keys.append(key_of(trials(folder)[0]))
        digests.append(scenario_digest(str(folder / "hall.toml")))
    assert len(set(keys)) == len(set(digests)) == 5


def test_a_sweep_goes_over_a_log_and_says_what_is_damaged(folder, capsys):
    torn = folder / "data" / "lap.csv"
    torn.write_text(torn.read_text() + "1,2,3\n")
    out = folder / "out"
    assert exit_code("sweep", folder / "sweep.toml", "--out", out, "--jobs", "1") == 0
    said = capsys.readouterr().err
    assert said.count("skipped 1 of 62 records: 1 unreadable") == 1
    rows = [row for row in lines(out) if row["offset"] == "0"]
    assert len(rows) == 6
    assert all(float(row["position_rmse"]) < 0.5 for row in rows if row["method"] == "mcl")


KIDNAP = 'kind = "kidnap"\nstep = 3'
BAD = [
    ("log = ", "", "names no log"),
    ("reference = ", "", "no reference to score by"),
    ("segment = 3.0", "segment = 900.0", "no stretch as long as that"),
    ("segment", "sigment", "did you mean 'segment'?"),
    ("[params]", f"[[disturbance]]\n{KIDNAP}\n[params]", "needs deqmcl_gym/Room-v0"),
]


@pytest.mark.parametrize(("old", "new", "named"), BAD)
def test_a_bad_world_is_refused_in_one_sentence_before_anything_is_written(
    folder, refusal, old, new, named
):
    kept = [line for line in SWEEP.splitlines() if new or not line.startswith(old)]
    text = "\n".join(kept).replace(old, new)
    (folder / "sweep.toml").write_text(text)
    refusal(["sweep", folder / "sweep.toml", "--out", folder / "out"], named)
    assert not (folder / "out").exists()


def test_an_agent_that_would_drive_a_log_is_refused(folder):
    changed = SCENARIO.replace("[env]", 'agent = "on-estimate"\n[env]\nplan = "none"')
    (folder / "hall.toml").write_text(changed)
    with refused("recorded actions"):
        scenario(str(folder / "hall.toml")).room()
