"""The built-in suites."""

from pathlib import Path

import pytest

from benchmarks.sweeps.running import check
from benchmarks.sweeps.sweepfile import SUITES, sweep_named, with_localizers
from benchmarks.tables.stats import least_worlds

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


def test_the_quick_look_has_worlds_enough_to_tell_with_two_methods_of_ones_own():
    quick = sweep_named("quick")
    assert quick.trials >= least_worlds(len(quick.localizers) - 1 + 2)
