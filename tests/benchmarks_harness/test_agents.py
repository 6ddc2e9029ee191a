"""Agents as methods: named with parameters, compared on the same worlds, and their laws."""

from dataclasses import replace

import pytest
from report_cases import TURNER, results, trials

from benchmarks.agents import AGENTS
from benchmarks.checks import check
from benchmarks.report.verdict import conclusion
from benchmarks.setup.names import scenario
from benchmarks.setup.overrides import Named
from benchmarks.sweeps.sweepfile import read_sweep, sweep_of
from benchmarks.tables.panels import baseline_of
from benchmarks.trials import Method, Trial
from benchmarks.trials.stage import Stage, key_of

TRIAL = Trial(scenario="guided", localizer="mcl", params=(), lag=0, seed=0, trial=0)
SWEEP = {"localizers": ["mcl-map", "mcl"], "scenario": "guided", "trials": 2}
BAD = TURNER.replace("        return np.array", "        {}\n        return np.array")


def driven(errors, agent, localizer="mcl", **params):
    return trials(localizer, errors, agent=Named(agent, params))


def test_agents_are_compared_on_the_same_worlds_with_the_same_localizer():
    rising = [float(e) for e in range(10, 22)]
    records = []
    for localizer, more in (("mcl", 0.0), ("mcl-map", 1.0)):
        records += driven([e + more for e in rising], "still", localizer)
        records += driven([e + more - 5 for e in rising], "/far/mine.py:Seeker", localizer)
    told = results(records, baseline="still")
    rows = told.table.set_index("label")
    named = [f"{agent} with {one}" for one in ("mcl", "mcl-map") for agent in ("still", "Seeker")]
    assert list(rows.index) == named
    assert list(rows["is_baseline"]) == [True, False, True, False]
    for localizer in ("mcl", "mcl-map"):
        row = rows.loc[f"Seeker with {localizer}"]
        assert (row["diff"], row.paired_worlds) == (-5.0, 12)
        assert row.reference == f"still with {localizer}"
    assert conclusion(told).startswith("Seeker with mcl is best: 10.5 px, 32 % below still with ")
    ranked = told.panels[0].ranked.set_index("label")
    assert ranked.loc["Seeker with mcl-map", "relation"] == "better"
    assert "/far" not in conclusion(told)


def test_a_baseline_that_is_a_localizer_is_compared_with_those_of_the_same_agent():
    one, other = Named("a"), Named("b")
    methods = [Method(name, agent=agent) for agent in (one, other) for name in ("mcl", "mcl-map")]
    against = [baseline_of(method, methods, "mcl") for method in methods]
    assert against == [methods[0], methods[0], methods[2], methods[2]]
    assert [baseline_of(m, methods, "a") for m in methods] == [*methods[:2], *methods[:2]]


def test_a_sweep_names_agents_and_their_parameters_and_trials_without_one_are_as_before(tmp_path):
    (tmp_path / "mine.py").write_text(TURNER)
    (tmp_path / "sweep.toml").write_text(
        'localizers = ["mcl"]\n[[vary]]\n'
        'agent = ["stale", "mine.py", { name = "mine.py:Turner", params = { by = 0.2 } }]\n'
    )
    sweep = read_sweep(tmp_path / "sweep.toml")
    mine = "mine.py:Turner"
    agents = [trial.agent for trial in sweep.cells()]
    assert agents == [Named("stale"), Named(mine), Named(mine, {"by": 0.2})]
    assert sweep.baseline == "stale"
    again = sweep_of(sweep.canonical(), title="a", takes=sweep.takes)
    assert [t.canonical() for t in again.distinct()] == [t.canonical() for t in sweep.distinct()]
    shifts = SWEEP | {"agent": "misplaced", "vary": [{"agent": {"shift": [0.0, 9.0]}}]}
    tuned = sweep_of(shifts, title="a")
    assert {trial.agent.params["shift"] for trial in tuned.cells()} == {0.0, 9.0}
    paper = {"scenario": "paper", "params": {"lag": 20, "particles": 1000}, "lag": 20, "trial": 3}
    plain = replace(TRIAL, localizer="deq-mcl", **paper)
    assert "agent" not in plain.canonical()
    assert plain.key("p") == "fedcf55a1f035e4dd81be01d88cddbce"  # of the version without agents


def test_a_scenario_gives_its_agent_parameters_and_another_one_changes_them(tmp_path):
    (tmp_path / "a.toml").write_text('base = "guided"\nagent = { name = "misplaced" }\n')
    (tmp_path / "b.toml").write_text('base = "a.toml"\nagent.params.shift = 25.0\n')
    assert scenario(f"{tmp_path}/b.toml").agent == Named("misplaced", {"shift": 25.0})
    (tmp_path / "c.toml").write_text('base = "b.toml"\nagent = "stale"\n')
    assert scenario(f"{tmp_path}/c.toml").agent == Named("stale")


def test_an_agent_of_a_trial_drives_and_its_code_is_in_the_key(tmp_path):
    (tmp_path / "mine.py").write_text(TURNER)
    ours = replace(TRIAL, agent=Named(f"{tmp_path}/mine.py:Turner", {"by": 0.3}))
    moments = Stage.of(ours).moments()
    next(moments)
    assert next(moments).action == pytest.approx([0.0, 0.3])
    before = key_of(ours)
    (tmp_path / "mine.py").write_text(TURNER + "# edited")
    assert key_of(ours) != before


@pytest.mark.parametrize("name", AGENTS)
def test_our_agents_keep_all_laws(name):
    assert check("agents", name).failed == ()


@pytest.mark.parametrize(
    ("law", "code"),
    [
        ("answers with actions", "return [0.0], None"),
        ("same rng same result", "import os; self.by = os.urandom(1)[0] / 1e3"),
        ("inputs not changed", "info['collided'] = 3"),
        ("global rng untouched", "np.random.random()"),
        ("survives an empty belief", "belief.points()[0][0]"),
    ],
)
def test_each_law_is_broken_by_an_agent(tmp_path, law, code):
    (tmp_path / "mine.py").write_text(BAD.format(code))
    failed = [verdict.law for verdict in check("agents", f"{tmp_path}/mine.py").failed]
    assert law in failed
