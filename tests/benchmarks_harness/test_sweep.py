"""Trials: each depends on itself alone, fails alone, and comes to a record or a reason."""

import math
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from deqmcl_command import process, python, records
from refusals import refused

import localizers
from benchmarks.console import FailedWarning
from benchmarks.execution.engines import Where
from benchmarks.report.writing import write_report
from benchmarks.setup.overrides import Named
from benchmarks.sweeps.design import Axis, Sweep
from benchmarks.sweeps.results import results_in
from benchmarks.sweeps.running import Options, begun, run_missing
from benchmarks.sweeps.store import writing
from benchmarks.sweeps.suites import paper_sweep
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials import attempt
from benchmarks.trials.attempt import provenance_of
from benchmarks.trials.spec import Method
from benchmarks.trials.stage import Stage


def suite(localizers=("mcl", "dead-reckoning"), trials=2, lag=4, particles=15):
    return paper_sweep(
        localizers=localizers, trials=trials, lag=lag, particles=particles
    ).distinct()


def run(trials, out):
    """Run trials; return the store and the trials by key."""
    made = provenance_of(trials)
    named = {made.key(trial): trial for trial in trials}
    with writing(out) as store:
        run_missing(named, store, Options(where=Where(jobs=1), progress=False), made)
    return store, named


def reasons(store, keys):
    """Why trials failed; None of those that did not."""
    return [store.failure(key) for key in keys]


def test_the_order_in_which_trials_run_changes_no_result(tmp_path):
    run(suite(), tmp_path / "a")
    run(suite()[::-1], tmp_path / "b")
    assert records(tmp_path / "a") == records(tmp_path / "b")


def test_all_methods_run_on_one_world_before_any_runs_on_the_next(tmp_path, ran):
    run(suite(trials=3), tmp_path)
    assert [trial.trial for trial in ran] == [0, 0, 1, 1, 2, 2]


def test_workers_that_loaded_other_code_than_the_sweep_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(attempt, "key_of", lambda trial: "another")
    (reason,) = set(reasons(*run(suite(), tmp_path)))
    assert "its worker loaded other code" in reason
    assert records(tmp_path) == {}


class Nowhere:
    """A belief that puts the robot nowhere at one offset, from step 4 on."""

    def __init__(self, offset, x):
        self.step, self._offset, self._x = 0, offset, x

    def reset(self, prior, plan, rng):
        return self

    def update(self, ranges, action, plan):
        self.step += 1
        return self

    def points(self, offset=0):
        x = self._x if offset == self._offset and self.step > 3 else 1.0
        return np.array([[x, 50.0, 0.0]]), np.ones(1)


def test_a_trial_of_no_steps_is_no_success(tmp_path, monkeypatch):
    trials = suite(["dead-reckoning"], trials=1)
    first = list(Stage.of(trials[0]).moments())[:1]
    monkeypatch.setattr(Stage, "moments", lambda _: first)
    assert reasons(*run(trials, tmp_path)) == ["it processed 0 steps"]


class Broken:
    """A localizer that fails in one of its calls."""

    def __init__(self, where):
        self._where = where
        self._fail("make")

    def reset(self, prior, plan, rng):
        self._fail("reset")
        return self

    def update(self, ranges, action, plan):
        self._fail("update")
        return None if self._where == "none" else self

    def points(self, offset=0):
        self._fail("points")
        return np.zeros((1, 3)), np.ones(1)

    def _fail(self, where):
        if self._where == where:
            raise ArithmeticError(f"broken in {where}")


CALLS = ("make", "reset", "update", "points")


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        *((partial(Broken, call), f"ArithmeticError: broken in {call}") for call in CALLS),
        (partial(Broken, "none"), "AttributeError"),
        (partial(sys.exit, 0), "SystemExit: 0"),
        (partial(Nowhere, 0, math.nan), "at offset 0 has poses that are not finite"),
        (partial(Nowhere, 2, 1e300), "at offset 2 has poses that are not finite or huge"),
    ],
)
def test_a_localizer_that_fails_fails_its_trials_with_the_reason_and_the_others_are_kept(
    tmp_path, monkeypatch, made, reason
):
    with localizers.registered("bad", lambda robot: made()):
        bad, good = reasons(*run(suite(["bad", "dead-reckoning"], trials=1), tmp_path))
    assert reason in bad
    assert good is None
    assert len(records(tmp_path)) == 1


class Sure:
    """Believes in one pose."""

    POSE = (1.0, 2.0, 0.0)

    def __init__(self, robot):
        pass

    def reset(self, prior, plan, rng):
        return localizers.PoseBelief(self.POSE)

    def update(self, ranges, action, plan):
        return localizers.PoseBelief(self.POSE)


ONE_JOB = Where(jobs=1)


def swept(out, names=("sure",), where=ONE_JOB, **said):
    """Run two trials of each method into a folder; return the results."""
    methods = tuple(Method(name=name) for name in names)
    sweep = Sweep(title="t", localizers=methods, trials=2, params={"particles": 15}, **said)
    with begun(sweep, out, Options(where=where, progress=False), command=[]) as running:
        return running.results()


def errors(results):
    return results.table.loc[results.table["offset"] == 0, "error"].tolist()


def test_a_class_that_was_changed_in_memory_is_not_taken_for_the_one_of_the_results(
    tmp_path, monkeypatch
):
    with localizers.registered("sure", Sure):
        (own,) = errors(swept(tmp_path))
        assert [own] == errors(swept(tmp_path))
        monkeypatch.setattr(Sure, "POSE", (300.0, 2.0, 0.0))
        with refused("plug-ins.sure was", "new --out"):
            swept(tmp_path)
        assert errors(swept(tmp_path / "new")) != [own]


def test_results_of_what_cannot_be_read_are_not_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(Sure, "SOURCE", (one for one in ()), raising=False)
    monkeypatch.setattr(Sure, "__module__", "a_cell")
    with localizers.registered("sure", Sure):
        assert swept(tmp_path).failures == []
        with refused("results of 'sure'", "cannot be read", "file.py"):
            swept(tmp_path)


@pytest.mark.parametrize(
    "where", [Where(jobs=2), Where(jobs=1, timeout=60.0), Where(executor="calls:processes")]
)
def test_what_was_registered_goes_along_to_other_processes(tmp_path, where):
    with localizers.registered("sure", Sure):
        assert errors(swept(tmp_path / "two", where=where)) == errors(swept(tmp_path / "one"))


def test_what_cannot_go_along_is_refused_before_anything_runs(tmp_path):
    unsendable = (one for one in ())
    with (
        localizers.registered("sure", lambda robot: [Sure(robot), unsendable][0]),
        refused("'sure' cannot be sent to other processes", "jobs=1", "file.py:NAME"),
    ):
        swept(tmp_path / "new", where=Where(jobs=2))
    assert records(tmp_path / "new") == {}


SCRIPT = """
import sys
from functools import partial
import localizers
from benchmarks.execution.engines import Where
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.running import Options, begun
from localizers.template import MyLocalizer

class Mine(MyLocalizer):
    pass

localizers.register("mine", partial(Mine, particles=9))

if __name__ == "__main__":
    sweep = Sweep(title="t", localizers=["mine", "__main__:Mine"], trials=2, lag=4)
    with begun(sweep, sys.argv[1], Options(where=Where(jobs=2)), command=[]) as running:
        print(len(running.results().records))
"""


def test_what_a_script_defines_and_registers_at_its_top_level_is_known_to_its_workers(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    said = [python(tmp_path / "script.py", tmp_path / "out") for _ in range(2)]
    assert [one.split()[-1] for one in said] == ["4", "4"]
    (tmp_path / "script.py").write_text(SCRIPT.replace("    pass", "    GAIN = 2"))
    done = process(sys.executable, tmp_path / "script.py", tmp_path / "out")
    assert "plug-ins.mine was" in done.stderr
    assert "plug-ins.__main__:Mine was" in done.stderr


def test_trials_that_fail_are_told_in_python_too(tmp_path):
    with (
        localizers.registered("bad", lambda robot: Broken("reset")),
        pytest.warns(FailedWarning, match="2 of 4 trials failed.*broken in reset"),
    ):
        swept(tmp_path, ("dead-reckoning", "bad"))


def test_nested_changes_are_those_of_dotted_names(tmp_path):
    nested = {"assumed": {"motion": "world", "scan": {"sigma": "world"}}}
    nested["world"] = {"lidar": {"beams": 3}}
    dotted = {"assumed": {"motion": "world", "scan.sigma": "world"}, "world": {"lidar.beams": 3}}
    results = swept(tmp_path, ("mcl",), **nested)
    assert results.failures == []
    assert swept(tmp_path, ("mcl",), **dotted).records == results.records
    assert results_in(tmp_path).records == results.records
    varied = Axis(values={"world": {"lidar": {"beams": [3, 9]}}})
    assert varied == Axis(values={"world.lidar.beams": [3, 9]})
    trial = replace(results.records[0].trial, **nested)
    assert reasons(*run([trial], tmp_path / "one")) == [None]


class Nearly(Sure):
    """Believes in two poses, whose weights add up to nearly 1."""

    OFF = 0.0

    def update(self, ranges, action, plan):
        return self

    def points(self, offset=0):
        poses = np.array([self.POSE, (300.0, 290.0, 0.0)])
        return None if offset else (poses, np.array([0.5, 0.5 + self.OFF]))


@pytest.mark.parametrize("agent", ["wall-follower", "greedy", "free-energy"])
@pytest.mark.parametrize(("off", "fails"), [(1e-6, False), (9e-4, False), (2e-3, True)])
def test_weights_add_up_to_1_or_not_whoever_drives(tmp_path, monkeypatch, agent, off, fails):
    monkeypatch.setattr(Nearly, "OFF", off)
    (trial,) = suite(["mcl"], trials=1)
    lost = replace(
        trial, scenario="lost", localizer="nearly", params={}, agent=Named(agent), lag=0,
        world={"horizon": 10}
    )  # fmt: skip
    with localizers.registered("nearly", Nearly):
        (reason,) = reasons(*run([lost], tmp_path))
    assert ("add up to 1" in str(reason)) == fails
    assert (reason is None) == (not fails)


def test_names_and_paths_are_taken_as_text_and_what_is_no_name_is_refused(tmp_path):
    how = Options(where=ONE_JOB, progress=False)
    sweep = Sweep(title="t", localizers=["mcl"], agent="open-loop", trials=1, lag=4)
    assert sweep.localizers == (Method(name="mcl"),)
    with begun(sweep, str(tmp_path / "out"), how, command=[]) as running:
        results = running.results()
    assert results_in(str(tmp_path / "out")).records == results.records
    assert write_report(str(tmp_path / "out"), results)
    (tmp_path / "l.toml").write_text('localizers = ["mcl"]')
    assert read_sweep(f"{tmp_path}/l.toml").names == ["mcl"]
    with refused("name of a localizer or agent is", "Sure", "registered"):
        Method(name=Sure)
    with refused("name of a localizer or agent is", "Sure"):
        Sweep(title="t", localizers=[Sure])
    with refused("localizers is 'mcl'", "a list"):
        Sweep(title="t", localizers="mcl")
    with refused("the results are", "folder first"):
        write_report(results, tmp_path)


def test_what_holds_a_whole_sweep_or_a_cloud_is_shown_on_a_line(tmp_path):
    (trial,) = suite(["deq-mcl"], trials=1)
    belief = next(iter(Stage.of(trial).moments())).belief
    assert repr(belief) == "<ParticleBelief of 15 particles at steps 0 to 4>"
    assert repr(swept(tmp_path, ("mcl",))) == "<Results of 't': 2 of 2 trials finished, 0 failed>"
