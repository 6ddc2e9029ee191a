"""What a notebook types: the numbers are those of the command; classes and policies of its own."""

import math

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest
from deqmcl_command import exit_code, python, stored
from refusals import refused

import benchmarks
import localizers
from benchmarks.report import page
from benchmarks.sweeps import Sweep
from localizers import PoseBelief

FEW = {"trials": 2, "params": {"particles": 20}, "lag": 4}
OFFICE = {"office": {"wings": 1, "corridors": 1, "seed": 3}}
MCL_MAP = {"name": "mcl-map", "particles": 500}
QUICK = {"floor_plan": OFFICE, "localizer": MCL_MAP, "max_steps": 40}


class Still:
    def __init__(self, robot, *, particles=1):
        self.particles = particles

    def reset(self, prior, plan, rng):
        return PoseBelief(prior.sample(1, rng)[0])

    def update(self, ranges, action, plan):
        return PoseBelief((100.0, 50.0, 0.0))


@pytest.fixture(scope="module")
def results():
    varied = {"params.particles": [20, 40]}
    experiment = benchmarks.sweep("paper", localizers=["mcl", Still], vary=varied, **FEW)
    return experiment.run(jobs=1, progress=False)


def test_the_tables_are_those_of_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(page, "no_report", lambda: "it is left out")
    file, out = tmp_path / "small.toml", tmp_path / "out"
    text = 'scenario = "paper"\nlocalizers = ["mcl", "deq-mcl"]\ntrials = 2\nlag = 4\n'
    file.write_text(text + "params.particles = 20\n")
    assert exit_code("sweep", file, "--out", out, "--jobs", "1") == 0
    ours = benchmarks.sweep(file).run(jobs=1, progress=False)
    for name, table in (("results", ours.table), ("trials", ours.trials)):
        printed = pd.read_csv(out / f"{name}.csv")
        pd.testing.assert_frame_equal(table[printed.columns], printed)
    assert repr(ours) in capsys.readouterr().out


def test_what_was_varied_is_a_column_and_a_line_over_it(results):
    assert results.table["particles"].tolist() == [20, 20, 40, 40]
    assert results.table["label"].tolist() == ["mcl", "Still", "mcl", "Still"]
    assert sorted(results.trials["particles"].unique()) == [20, 40]
    (axes,) = results.plot("particles").axes
    drawn = {line.get_label(): line for line in axes.lines}
    assert list(drawn) == ["mcl", "Still"]
    for label, line in drawn.items():
        rows = results.table[results.table["label"] == label]
        x, y = line.get_data()
        np.testing.assert_array_equal(x, rows["particles"])
        np.testing.assert_array_equal(y, rows["error"])
    with refused("there is no column 'lidar.sigma' of numbers: it has"):
        results.plot("lidar.sigma")
    assert results.plot("particles", "position_rmse")._repr_png_().startswith(b"\x89PNG")


def test_in_jupyter_results_are_a_verdict_and_a_table_of_what_varies(results):
    html = results._repr_html_()
    assert repr(results) in html
    assert "<th>particles</th>" in html
    assert "<th>seed</th>" not in html
    assert "NaN" not in html  # the baseline's difference from itself
    assert len(repr(results)) < 300


def test_a_folder_is_gone_on_with_and_without_one_nothing_is_left(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    experiment = benchmarks.sweep("paper", localizers=["mcl"], **FEW)
    first = experiment.run(jobs=1, out=tmp_path / "mine", progress=False)
    kept = stored(tmp_path / "mine")
    again = experiment.run(jobs=1, out=str(tmp_path / "mine"), progress=False)
    assert stored(tmp_path / "mine") == kept
    pd.testing.assert_frame_equal(first.table, again.table)
    assert not list((tmp_path / "temporary").glob("*/experiment"))


def test_a_run_is_a_trial_step_by_step_with_a_picture_of_each():
    steps = list(benchmarks.run("paper", "deq-mcl-fresh", seed=3, particles=20, lag=4))
    assert [step.t for step in steps] == list(range(len(steps)))
    assert steps[0].action is None
    assert steps[10].action.shape == (2,)
    assert steps[10].belief.points(4)[0].shape == (20, 3)
    picture = steps[10].draw()
    assert picture.dtype == np.uint8
    assert picture.shape[2] == 3
    assert np.ptp(picture) > 0
    other = list(benchmarks.run("paper", Still, seed=3))
    np.testing.assert_array_equal(steps[10].truth, other[10].truth)  # paired


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"of": "quik"}, "unknown suite or scenario 'quik': did you mean 'quick'?"),
        ({"localizers": [lambda robot: Still(robot)]}, "with a name"),  # noqa: PLW0108
        ({"localizers": [Still, type("Still", (Still,), {})]}, "two localizers are called Still"),
        ({"vary": {"params.particles": 3}}, "[[vary]] params.particles is 3, but must be a list"),
    ],
)
def test_bad_input_gets_one_sentence(given, words):
    with refused(words):
        benchmarks.sweep(**given)


def test_an_experiment_keeps_its_classes_and_registers_nothing():
    there = set(localizers.names())

    def made(x):
        return type("Placed", (Still,), {"update": lambda *_: PoseBelief((x, 50.0, 0.0))})

    places = (made(x) for x in (100.0, 300.0))
    first, second = (benchmarks.sweep("paper", localizers=["mcl", own], **FEW) for own in places)
    errors = [one.run(jobs=1, progress=False).table["error"][1] for one in (first, second, first)]
    assert errors[0] == errors[2] != errors[1]
    assert repr(first) == '<Experiment "The paper\'s experiment": 4 trials of mcl, Placed>'
    assert set(localizers.names()) == there


def test_numpy_s_numbers_are_numbers_and_each_other_axis_has_a_line_of_its_own():
    varied = {"params.particles": np.arange(10, 30, 10), "world.lidar.beams": [1, np.int64(3)]}
    found = benchmarks.sweep("paper", localizers=["mcl"], vary=varied, **FEW | {"params": {}})
    table = (results := found.run(jobs=1, progress=False)).table
    pairs = sorted(zip(table["particles"], table["beams"], strict=True))
    assert pairs == [(10, 1), (10, 3), (20, 1), (20, 3)]
    (axes,) = results.plot("particles").axes
    assert [line.get_label() for line in axes.lines] == ["mcl, beams = 1", "mcl, beams = 3"]


def test_a_parameter_that_is_called_like_a_column_keeps_its_whole_name():
    def shifted(robot, offset=0):
        return Still(robot)

    varied = {"params.offset": [1, 2]}
    experiment = benchmarks.sweep("paper", localizers=["mcl", shifted], vary=varied, **FEW)
    table = experiment.run(jobs=1, progress=False).table
    assert set(table["offset"]) == {0}
    assert sorted(set(table["params.offset"])) == [1, 2]


def test_a_sweep_of_ones_own_and_all_its_fields_are_taken():
    own = {"title": "mine", "localizers": ("mcl",), "trials": 3}
    assert benchmarks.sweep(Sweep(**own), seed=5).sweep == Sweep(**own, seed=5)
    zipped = [{"scenario": ["paper", "guided"], "params.particles": [10, 20]}]
    assert benchmarks.sweep("paper", vary=zipped, localizers=["mcl"]).sweep.planned == 20
    assert benchmarks.sweep("paper").sweep.baseline == "mcl"


MINE = """
from localizers import PoseBelief
START = 100.0
class {name}:
    def __init__(self, robot): pass
    def reset(self, prior, plan, rng): return PoseBelief(prior.sample(1, rng)[0])
    def update(self, ranges, action, plan): return PoseBelief((START, 50.0, 0.0))
"""
CELL = """
import benchmarks
from mine import OfModule
if __name__ == "__main__":
    few = {"trials": 2, "params": {"particles": 20}}
    sweep = benchmarks.sweep("paper", localizers=["mcl", OfModule, OfCell], **few)
    print(*(sweep.run(jobs=jobs, progress=False).table.to_csv() for jobs in (1, 2)), sep="=====")
"""


def test_classes_of_a_cell_and_a_module_have_the_same_numbers_in_one_process_and_in_two(tmp_path):
    (tmp_path / "mine.py").write_text(MINE.format(name="OfModule"))
    cell = MINE.format(name="OfCell") + CELL  # code without a file
    one, two = python("-c", cell, cwd=tmp_path).strip().split("=====")
    assert one.strip() == two.strip()
    assert "OfCell" in one
    assert "OfModule" in one


def spinning(seen, info):
    sure = float(seen["confident"][0] >= 1.0)
    return np.array([0.0, 0.0 if sure else math.pi / 12, sure], np.float32)


class Model:
    """Has ``predict``, as models of Stable-Baselines3; notes with which state it was asked."""

    def __init__(self):
        self.asked = []

    def predict(self, seen, state=None, episode_start=None, deterministic=False):
        self.asked.append((state, bool(episode_start[0]), deterministic))
        return spinning(seen, {}), (0 if state is None else state + 1)


def test_a_policy_that_does_what_the_reference_does_gains_nothing_in_any_form():
    model = Model()
    how = {"episodes": 3, **QUICK}
    rows = [benchmarks.evaluate("Localize-v0", one, **how).row for one in (spinning, model)]
    assert [row["gain"] for row in rows] == [0.0, 0.0]
    assert rows[0]["policy"] == "spinning"
    begun = [asked for asked in model.asked if asked[1]]
    assert begun == [(None, True, True)] * 3
    assert all(state is not None for state, first, _ in model.asked if not first)


def test_the_return_is_that_of_the_env_whatever_it_is_wrapped_in():
    def small(env):
        return gym.wrappers.TransformReward(env, lambda reward: reward / 100)

    how = {"episodes": 2, "reference": None, **QUICK}
    both = [benchmarks.evaluate("Localize-v0", spinning, wrap=one, **how) for one in (None, small)]
    plain, wrapped = both
    assert plain.episodes.equals(wrapped.episodes)
    assert (plain.episodes["return"] < -10).all()


def test_a_row_counts_what_happened():
    played = benchmarks.evaluate("Sharp-v0", "plan", episodes=3, reference=None)
    done, row = played.episodes["done"], played.row
    assert 0 < done.sum() < 3  # noise leaves the robot short of the line in one of them
    assert (played.episodes["return"] == 992).equals(done)  # the most that a lap pays
    assert row["done low"] < row["done"] == done.mean() < row["done high"]
    assert row["steps"] == played.episodes["steps"][done].max()  # the middle of two and infinity
    assert row["metres"] == pytest.approx(18.0, abs=0.5)  # 900 px, the lap
    assert "plan in Sharp-v0, 3 episodes: return" in str(played)


def test_what_cannot_be_evaluated_is_refused():
    base = benchmarks.evaluate("Room-v0", "spin", episodes=1, reference=None)
    for task, policy, options, words in (
        ("Lokalize-v0", spinning, {}, "unknown task 'Lokalize-v0': did you mean"),
        ("Localize-v0", "spinn", {}, "unknown policy of Localize-v0 'spinn': did you mean 'spin'"),
        ("Localize-v0", spinning, {"episodes": 0}, "episodes is 0"),
        ("Room-v0", "still", {"episodes": 2, "reference": base}, "has 1 episodes, but 2 are"),
    ):
        with refused(words):
            benchmarks.evaluate(task, policy, **{"reference": None} | options)
