"""Scan models from other people's code: found, keyed by their code, used by filters; their laws."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from following import follow, same
from refusals import refused
from report_cases import trial_of

import localizers
from benchmarks.checks import check
from benchmarks.cli import main
from benchmarks.setup.names import scenario
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials.stage import Stage, guest_of, key_of
from localizers.models.scan import BEAM_MODELS, LidarScan, Scan
from localizers.registry import ScanPlugIn

MODEL = """
import numpy as np
from localizers import GaussianUniform
from localizers.models.scan import LidarScan


class Same:
    def __init__(self, floor_plan, lidar, *, sigma=100.0):
        beam = GaussianUniform(sigma=sigma)
        self.model = LidarScan(floor_plan=floor_plan, lidar=lidar, beam=beam)

    def log_likelihood(self, states, scan):
        return self.model.log_likelihood(states, scan)
"""
ASKED = """
import numpy as np


class Model:
    def __init__(self, floor_plan, lidar):
        self.floor_plan, self.lidar, self.asked = floor_plan, lidar, 0

    def log_likelihood(self, states, scan):
        self.asked += 1
        expected = self.lidar.ranges(self.floor_plan, states, scan.usable)
        found = -np.abs(np.nan_to_num(expected) - scan.ranges[scan.usable]).sum(axis=1)
        {}
        return found
"""
TRIAL = trial_of("mcl", 0, scenario="guided", params={"particles": 50}, lag=0)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(MODEL)
    return path


def errors(trial):
    return [moment.belief.points()[0].tolist() for moment in Stage.of(trial).moments()][:20]


@pytest.mark.parametrize("name", ["mcl", "mcl-map-smoother", "deq-mcl-fresh", "mcl-plan-hedged"])
def test_a_plug_in_like_the_built_in_model_gives_its_beliefs(file, robot, prior, drive, name):
    ours = replace(robot, scan=localizers.GaussianUniform(sigma=30.0))
    theirs = replace(robot, scan=ScanPlugIn(kind=str(file), params={"sigma": 30.0}))
    made = (localizers.make(name, known, particles=60) for known in (ours, theirs))
    runs = [follow(localizer, prior, drive) for localizer in made]
    assert same(*runs)


def test_the_power_scales_its_log_likelihood_also_of_more_poses_than_a_block(file, robot):
    states = np.random.default_rng(0).uniform(20, 150, (3, 9000)).astype(np.float32)
    scan = Scan.of(np.full(robot.lidar.beams, 40.0), robot.lidar.max_range)
    made = ScanPlugIn(kind=str(file), power=0.25).made(robot.floor_plan, robot.lidar)
    beam = localizers.GaussianUniform()
    own = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=beam)
    told = made.log_likelihood(states, scan)
    assert np.array_equal(told, 0.25 * own.log_likelihood(states, scan))
    nothing = Scan.of(np.full(robot.lidar.beams, np.nan), robot.lidar.max_range)
    assert not made.log_likelihood(states, nothing).any()


def test_a_scenario_and_a_sweep_find_it_from_their_own_folder(file, tmp_path):
    assumed = 'assumed.scan = { kind = "mine.py", sigma = 40.0 }'
    (tmp_path / "room.toml").write_text(f'base = "guided"\n{assumed}\n')
    found = scenario(f"{tmp_path}/room.toml").scan
    assert (found.kind, found.params) == (f"{file}:Same", {"sigma": 40.0})
    (tmp_path / "sweep.toml").write_text(
        'scenario = "guided"\nlocalizers = ["mcl"]\ntrials = 1\n[[vary]]\n'
        'assumed.scan.kind = ["gaussian-uniform", "mine.py:Same"]\n'
    )
    cells = read_sweep(tmp_path / "sweep.toml").cells()
    kinds = [t.assumed["scan.kind"] for t in cells]
    assert kinds == ["gaussian-uniform", "mine.py:Same"]
    assert localizers.absolute_name(kinds[1]) == f"{file}:Same"


def test_its_code_and_the_files_it_ships_are_in_the_key_of_a_trial(file, tmp_path):
    (tmp_path / "room.toml").write_text('base = "guided"\nassumed.scan.kind = "mine.py"\n')
    kind = replace(TRIAL, assumed={"scan.kind": f"{file}:Same"})
    trials = kind, replace(TRIAL, scenario=f"{tmp_path}/room.toml")
    for trial in trials:
        assert f"{file}:Same" in guest_of(trial).split()
    before = [key_of(trial) for trial in trials]
    file.write_text(MODEL + "# edited")
    edited = [key_of(trial) for trial in trials]
    (tmp_path / "mine.npz").write_bytes(b"weights")
    shipped = [key_of(trial) for trial in trials]
    assert all(len(set(keys)) == 3 for keys in zip(before, edited, shipped, strict=True))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("np.zeros(3)", r"'mine.py:Model' answered with shape \(3,\) to 50 poses"),
        ("found * np.nan", "'mine.py:Model' answered nan at the pose"),
        ("1 / 0", r"'mine.py:Model' raised ZeroDivisionError.*\(mine.py, line 13\)"),
    ],
)
def test_a_model_that_answers_amiss_fails_its_trial_in_a_sentence(tmp_path, answer, words):
    (tmp_path / "mine.py").write_text(ASKED.format(f"return {answer}"))
    trial = replace(TRIAL, assumed={"scan.kind": f"{tmp_path}/mine.py:Model"})
    with pytest.raises(RuntimeError, match=words):
        errors(trial)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("away.py", ["scan model 'away.py' cannot be read"]),
        ("json:loads", ["'json:loads' cannot be made", "TypeError"]),
        ("builtins:dict", ["'builtins:dict' is of type dict, without log_likelihood"]),
        ("gausian-uniform", ["did you mean 'gaussian-uniform'?", "or your own as file.py:NAME"]),
    ],
)
def test_what_is_no_scan_model_is_refused_at_once(file, here, kind, words):
    with refused(*words):
        Stage.of(replace(TRIAL, assumed={"scan.kind": kind})).check()


@pytest.mark.parametrize(
    "signature", ["sigma=100.0, floor_plan=None, lidar=None", "*, sigma, lidar, floor_plan"]
)
def test_its_arguments_may_stand_in_any_order(file, robot, signature):
    file.write_text(MODEL.replace("floor_plan, lidar, *, sigma=100.0", signature))
    made = ScanPlugIn(kind=str(file), params={"sigma": 30.0}).made(robot.floor_plan, robot.lidar)
    assert made.model.model.beam.sigma == 30.0
    with refused("parameter of scan model", "did you mean 'sigma'"):
        ScanPlugIn(kind=str(file), params={"sigmas": 1.0}).made(robot.floor_plan, robot.lidar)


def test_who_asks_it_of_single_beams_is_told_what_to_ask(file, robot):
    scan = copy.deepcopy(pickle.loads(pickle.dumps(ScanPlugIn(kind=str(file)))))
    assert scan == ScanPlugIn(kind=str(file))
    words = r"scan model 'mine.py:Same' tells only of whole scans.* no hit_moments: ask robot"
    with pytest.raises(AttributeError, match=words):
        _ = replace(robot, scan=scan).scan.hit_moments


@pytest.mark.parametrize(
    ("name", "params"), [("grid", {}), ("ekf", {}), ("mcl", {"beam_filter": "distance"})]
)
def test_what_looks_at_single_beams_refuses_a_model_of_whole_scans(file, robot, name, params):
    known = replace(robot, scan=ScanPlugIn(kind=str(file)))
    with refused("scan model"):
        localizers.make(name, known, **params)


@pytest.mark.parametrize("kind", BEAM_MODELS)
def test_our_scan_models_keep_all_laws(kind):
    assert check("scan models", kind).failed == ()


@pytest.mark.parametrize(
    ("law", "code"),
    [
        ("answers with numbers", "found = found[1:]"),
        ("answers with numbers", "found[0] = np.nan if scan.beams < scan.ranges.size else 0"),
        ("same input same answer", "found += self.asked"),
        ("inputs not changed", "states[2] = 0"),
        ("each pose by itself", "found -= found.max()"),
        ("global rng untouched", "np.random.random()"),
        ("the truth is likelier", "found[:] = 0"),
    ],
)
def test_each_law_is_broken_by_a_scan_model(tmp_path, law, code):
    (tmp_path / "mine.py").write_text(ASKED.format(code))
    failed = [verdict.law for verdict in check("scan models", f"{tmp_path}/mine.py").failed]
    assert law in failed


def test_the_command_tries_a_plug_in_and_tells_of_each_law(here, capsys):
    (here / "mine.py").write_text(ASKED.format(""))
    assert main(["check", "mine.py:Model", "--scan"]) == 0
    assert "mine.py:Model keeps all laws of scan models." in capsys.readouterr().out
    (here / "mine.py").write_text(ASKED.format("found[:] = 0"))
    assert main(["check", "mine.py:Model", "--scan"]) == 3
    assert "'the truth is likelier'" in capsys.readouterr().err


def test_a_scan_model_that_is_none_is_refused():
    with refused("unknown kind of scan 'beam'", "did you mean 'beam-model'"):
        check("scan models", "beam")
