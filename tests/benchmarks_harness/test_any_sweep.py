"""Of any sweep: the tables of the page and results.csv, against plain loops over its trials."""

import math
from collections import defaultdict

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_cases import finished, parsed, results, results_csv

from benchmarks.report.tables import verdict_table
from benchmarks.tables.stats import holm

NAMES = ("mcl", "mcl-map", "deq-mcl", "ekf")


@st.composite
def sweeps(draw):
    """Trials of one setting or two; methods have both, one or none of two swept parameters."""
    axes = {"particles": draw(st.sampled_from([(10,), (10, 30)])), "beta": (1.0, math.inf)}
    records = []
    for name in draw(st.lists(st.sampled_from(NAMES), min_size=1, unique=True)):
        variants = [{}]
        for axis in draw(st.sets(st.sampled_from(sorted(axes)))):
            variants = [one | {axis: value} for one in variants for value in axes[axis]]
        offsets = draw(st.sampled_from([(0,), (0, -20), (0, -20, 20)]))
        for params in variants:
            for world in draw(st.sets(st.integers(0, 7), min_size=1)):
                for seed in range(draw(st.integers(1, 2))):
                    error = {k: draw(st.integers(0, 5)) + k / 20 for k in offsets}
                    where = {"scenario": draw(st.sampled_from(["paper", "paper", "sharp"]))}
                    one = finished(name, world, error, filter_seed=seed, params=params, **where)
                    records.append(one)
    return draw(st.permutations(records)), draw(st.sampled_from(NAMES))


def errors(records, row):
    """Errors of a method of a panel, by offset, world and filter seed."""
    found = {}
    for record in records:
        trial = record.trial
        if (trial.scenario, trial.localizer) == row[:2] and dict(trial.params) == row[2]:
            for score in record.scores:
                found[score["offset"], *trial.run] = score["error"]
    return found


def agreed(some, others):
    """Whether what two methods both have is the same."""
    return all(some[name] == others[name] for name in some.keys() & others.keys())


def expected_difference(own, theirs, offset):
    """The mean over shared worlds of the mean over shared runs."""
    worlds = defaultdict(list)
    for (k, world, seed), error in own.items():
        if k == offset and (0, world, seed) in theirs:
            worlds[world].append(error - theirs[0, world, seed])
    means = [sum(apart) / len(apart) for apart in worlds.values()]
    return (sum(means) / len(means) if means else math.nan), len(means)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(sweeps())
def test_differences_are_those_of_the_trials_and_each_table_is_one_family_of_tests(given_sweep):
    records, baseline = given_sweep
    told = results(records, baseline=baseline)
    found, seen = told.panels, set()
    for panel in found:
        names = [method.name for method in panel.labels]
        rows = told.table[told.table["panel"] == panel.number]
        scenario, methods = panel.setting.scenario, {v: k for k, v in panel.labels.items()}
        for row in rows.itertuples():
            method, reference = methods[row.label], methods[row.reference]
            params, base = (dict(m.params) for m in (method, reference))
            assert reference.name == (baseline if baseline in names else names[0])
            same = [m for m in panel.labels if m.name == reference.name]
            assert agreed(base, params) or not any(agreed(dict(m.params), params) for m in same)
            own = errors(records, (scenario, method.name, params))
            theirs = errors(records, (scenario, reference.name, base))
            seen.add((scenario, method, row.offset))
            if row.is_baseline:
                assert math.isnan(row.diff)
                continue
            mean, worlds = expected_difference(own, theirs, row.offset)
            assert row.diff == pytest.approx(mean, nan_ok=True)
            assert row.paired_worlds == worlds
        for _, family in rows.groupby("offset"):
            corrected = holm(list(family["p"]))
            assert list(family["p_holm"]) == pytest.approx(corrected, rel=1e-5, nan_ok=True)
    of_records = {
        (panel.setting.scenario, method, offset)
        for panel in found
        for method, runs in panel.records.items()
        for record in runs
        for offset in record.offsets
    }
    assert seen == of_records
    assert sum(len(runs) for panel in found for runs in panel.records.values()) >= len(records)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(sweeps())
def test_the_tables_have_the_digits_of_results_csv(given_sweep):
    lines = parsed(results_csv(given_sweep[0], baseline=given_sweep[1]))
    present = iter([line for line in lines if line["offset"] == "0"])
    shown = results(given_sweep[0], baseline=given_sweep[1]).panels
    by_error = []
    for panel in shown:
        own = [next(present) for _ in range(len(panel.present))]
        by_error += [own[list(panel.present.index).index(n)] for n in panel.ranked.index]
    first = [told for panel in shown for told in verdict_table(panel).frame.to_dict("records")]
    for line, told in zip(by_error, first, strict=True):
        assert told["error e, px (SD)"].startswith(f"{float(line['error']):.2f} (")
        apart = told["difference to the baseline (95 %)"]
        if line["p_holm"]:
            assert apart.startswith(f"{float(line['diff']):+.2f}".replace("-", "−"))
            assert told["p, Holm"] == f"{float(line['p_holm']):.2g}"
        else:
            assert (apart, told["p, Holm"]) in (("baseline", "–"), ("n/a", "–"))
        share = 100 * float(line["lost_rate"])
        assert told["lost runs (95 %)"].startswith(f"{share:.0f} % of {line['runs']} (")
        assert told["worlds"] == line["worlds"]
