"""The built-in suites."""

from pathlib import Path

import numpy as np
import pytest
from report_cases import trials

from benchmarks.sweeps.running import check
from benchmarks.sweeps.suites import SUITES, sweep_named
from benchmarks.sweeps.sweepfile import with_localizers
from benchmarks.tables.panels import panels
from benchmarks.tables.stats import least_worlds
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage

REPORTS = Path(__file__).parents[2] / "docs" / "reports"
BESIDE = [path.relative_to(REPORTS).as_posix() for path in sorted(REPORTS.glob("*/*.toml"))]


@pytest.mark.parametrize("name", [name for name in SUITES if name != "basin"])  # needs a log
def test_every_built_in_suite_can_be_made(name):
    check(sweep_named(name))


@pytest.mark.parametrize("name", [name for name in BESIDE if "/log-" not in name])
def test_every_sweep_beside_its_report_can_be_made(name):
    check(sweep_named(str(REPORTS / name)))


def test_a_localizer_added_to_a_suite_runs_on_its_worlds_and_one_it_has_is_not_added():
    quick = sweep_named("quick")
    assert with_localizers(quick, ["mcl"]) == quick
    noise = with_localizers(sweep_named("noise"), ["ekf", "ekf"])
    assert [method.name for method in noise.localizers].count("ekf") == 1
    worlds = [t.world for t in noise.distinct() if t.localizer == "ekf"]
    assert worlds == [t.world for t in noise.distinct() if t.localizer == "mcl"]


def test_the_plan_of_the_disturbed_suite_leads_back_to_the_start():
    change = sweep_named("disturbed").vary[0].values["disturbance"][3]
    still = (("noise.drive", 0.0), ("noise.turn", 0.0), ("noise.drift", 0.0))
    trial = Trial(scenario="sharp", world=still, disturbance=change,
                  localizer="dead-reckoning", params=(), lag=0, seed=0, trial=0)  # fmt: skip
    truths = [m.truth for m in Stage.of(trial).moments()]
    assert len(truths) == 1 + 100 + 12 + 23 + 6 + 40 + 6 + 25
    assert np.allclose(truths[-1][:2], truths[0][:2], atol=1e-3)  # float32 actions


def test_the_quick_look_has_worlds_enough_to_tell_with_two_methods_of_ones_own():
    quick = sweep_named("quick")
    assert quick.trials >= least_worlds(len(quick.localizers) - 1 + 2)


def test_amcl_with_the_assumptions_of_all_others_is_told_from_navs_by_its_words():
    own = {"laser_model_type": "robot", "update_min_d": 0.0}
    variants = [{}, own, {"laser_model_type": "beam", "update_min_d": 0.0}]
    records = [r for p in variants for r in trials("amcl", [1.0, 2.0], params=p)]
    (panel,) = panels([*trials("mcl", [1.0, 2.0]), *records])
    expected = ["mcl", "amcl", "amcl laser_model_type=robot", "amcl laser_model_type=beam"]
    assert sorted(panel.labels.values()) == sorted(expected)
    for name in ("plan-sensor", "matched-sharp", "lost", "kidnapped", "driving", "disturbed"):
        models = [
            dict(method.params).get("laser_model_type", "Nav2's")
            for method in sweep_named(name).localizers
            if method.name == "amcl"
        ]
        assert models == ["Nav2's", "robot"]
