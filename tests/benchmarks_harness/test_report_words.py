"""What a report says of made-up results: verdicts, and tables in words."""

import re

import pytest
import report_cases
from report_cases import finished, lines_of, paired, panel_of, parsed, results, trials

from benchmarks.report import tables
from benchmarks.report.verdict import conclusion, verdict_on
from benchmarks.tables import file_words
from benchmarks.tables.panels import panels
from benchmarks.trials.scoring import RecordedTrack

ONE = (0,)

RELATIONS = [
    ("better", 20, [16] * 25),
    ("worse", 20, [24] * 25),
    ("inconclusive", 20, [19, 21] * 15),
    ("inconclusive", 20, [*range(1, 20), 900]),  # one world outweighs nineteen: the test alone
    ("equal", 5, [5] * 20),
    ("not compared", 5, [1]),
]


def relations(records):
    rows = panel_of(records).ranked
    return dict(zip(rows["label"], rows["relation"], strict=True))


@pytest.mark.parametrize(("expected", "theirs", "errors"), RELATIONS)
def test_the_table_says_what_is_known_of_a_difference(expected, theirs, errors):
    records = trials("mcl", [float(theirs)] * len(errors)) + trials("a", errors)
    assert relations(records) == {"mcl": "baseline", "a": expected}


@pytest.mark.parametrize("methods", [1, 2])
@pytest.mark.parametrize("worlds", [2, 5, 6, 7])
def test_of_few_shared_worlds_it_is_better_only_if_a_test_can_show_it(methods, worlds):
    names = ["a", "b"][:methods]
    records = trials("mcl", [9.0] * 25)  # worlds that the other has not count for nothing
    records += [one for name in names for one in trials(name, [8.0] * worlds)]
    # all on one side is p = 2 / 2^n, times as many tests as there are
    possible = methods * 2 / 2**worlds < 0.05
    expected = "better" if possible else "inconclusive"
    assert relations(records) == {"mcl": "baseline"} | dict.fromkeys(names, expected)


def test_what_is_unknown_or_of_other_worlds_is_not_compared():
    unknown = [finished("mcl", 0, 1.0), finished("a", 0, None)]
    elsewhere = [*trials("mcl", [5.0, 5.0]), finished("a", 2, 1.0)]
    assert relations(unknown)["a"] == relations(elsewhere)["a"] == "not compared"


def test_a_localizer_that_is_not_ours_is_marked_however_it_is_named():
    names = ("mcl", "mcl-h", "installed-by-entry-point", "./file.py:Mine")
    table = tables.verdict_table(panel_of(one for n in names for one in trials(n, [1.0])))
    plug_ins = [line[0] for line in lines_of(table) if line[0].endswith(" (plug-in)")]
    assert plug_ins == ["installed-by-entry-point (plug-in)", "Mine (plug-in)"]


def test_what_is_not_available_reads_na_in_the_tables_never_nan():
    none = dict.fromkeys(("coverage_50", "coverage_80", "coverage_95", "nees", "entropy"))
    records = [finished(name, 0, 1.0, scores=none) for name in ("mcl", "dead-reckoning")]
    panel = panel_of(records)
    made = (tables.verdict_table, tables.calibration_table)
    cells = [cell for table in made for line in lines_of(table(panel)) for cell in line]
    assert "n/a" in cells
    assert not [cell for cell in cells if re.search("nan|None", cell)]


def test_at_a_glance_every_error_has_the_mark_of_its_relation():
    records = paired({"mcl": (20.0, ONE), "a": (16.0, ONE), "b": (24.0, ONE)}, worlds=25)
    records += paired({"mcl": (20.0, ONE), "a": (16.0, ONE)}, worlds=4, scenario="sharp")
    table = tables.glance_table(report_cases.panels_of(records))
    lines = lines_of(table)
    assert list(table.frame) == ["setting", "mcl", "a", "b"]
    assert [line[0] for line in lines] == ["1. paper", "2. sharp"]
    assert [cell[-1] for cell in lines[0][2:]] == ["▼", "▲"]
    assert lines[0][1][-1].isdigit()  # the baseline
    assert [cell[-1] for cell in lines[1][2:]] == ["○", "–"]


def test_the_verdict_has_the_numbers_of_results_csv_and_timings_csv(tmp_path):
    records = paired({"mcl": (20.0, ONE), "mcl-map": (15.0, ONE), "grid": (17.0, ONE)}, worlds=12)
    report_cases.written(tmp_path, results(records))
    rows = {row["method"]: row for row in parsed((tmp_path / "results.csv").read_text())}
    times = parsed((tmp_path / "timings.csv").read_text())
    spent = {row["method"]: float(row["ms_per_step"]) for row in times}
    best = rows["mcl-map"]
    low, mean, high = (-100 * float(best[f"relative{end}"]) for end in ("_high", "", "_low"))
    expected = (
        f"mcl-map is best: {float(best['error']):.1f} px, {mean:.0f} % "
        f"below mcl (95 %: {low:.0f} to {high:.0f}), smaller in "
        f"{float(best['win_rate']) * int(best['paired_worlds']):g} of 12 worlds; costs "
        f"{spent['mcl-map'] / spent['mcl']:.2g} × the time."
    )
    cells = tables.verdict_table(panel_of(records)).frame.set_index("method").loc["mcl-map"]
    assert cells["error e, px (SD)"].startswith(f"{float(best['error']):.2f} (")
    apart = f"{float(best['diff']):+.2f}".replace("-", "−")
    assert cells["difference to the baseline (95 %)"].startswith(apart)
    assert (cells["p, Holm"], cells["worlds"]) == (f"{float(best['p_holm']):.2g}", best["worlds"])
    share = float(best["diff"]) / float(rows["mcl"]["error"])
    assert float(best["relative"]) == pytest.approx(share)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    numbers = expected.partition(": ")[2]
    assert f'<p class="verdict"><strong>mcl-map is best</strong> {numbers}</p>' in page
    assert conclusion(results(records)) == expected


CASES = {
    "mcl alone, nothing to compare it with: 20.0 px.": {"mcl": [20.0] * 9},
    "No method is better than the baseline, mcl: 20.0 px.": {"mcl": [20.0] * 9, "ekf": [21.0] * 9},
    "No method is confirmed to be better than mcl, 20.0 px: first is ekf, 16.0 px, 20 % below mcl "
    "(95 %: 20 to 20), smaller in 5 of 5 worlds, p < 0.05 needs 6 worlds with the tests of this "
    "section (1).": {"mcl": [20.0] * 5, "ekf": [16.0] * 5},
    "No method is confirmed to be better than mcl, 20.0 px: first is ekf, 19.0 px, 5.0 % below mcl "
    "(95 %: −1.2 to 11.6), smaller in 5 of 8 worlds, p = 0.25.": {
        "mcl": [20.0] * 8,
        "ekf": [16.0, 17, 18, 18.5, 19.5, 20.5, 21, 21.5],
    },
    "Too few worlds to compare methods: first is ekf, 16.0 px.": {"mcl": [20.0], "ekf": [16.0]},
    "dead-reckoning is best: 9.00 px, 55 % below mcl (95 %: 55 to 55), smaller in 9 of "
    "9 worlds; costs 4.7 × the time. Of the methods that use scans: ekf is best: 16.0 px, "
    "20 % below mcl (95 %: 20 to 20), smaller in 9 of 9 worlds; costs 1.0 × the time.": {
        "mcl": [20.0] * 9,
        "dead-reckoning": [9.0] * 9,
        "ekf": [16.0] * 9,
    },
    "ekf is best: 16.0 px, 20 % below mcl (95 %: 20 to 20), smaller in 9 of 9 worlds; costs 1.0 × "
    "the time (grid has 14.4 px, which is not confirmed).": {
        "mcl": [20.0] * 9,
        "ekf": [16.0] * 9,
        "grid": [1.0, 1, 1, 1, 21, 22, 27, 27, 29],
    },
}


@pytest.mark.parametrize("expected", CASES)
def test_the_verdict_says_only_what_is_known(expected):
    records = [one for name, errors in CASES[expected].items() for one in trials(name, errors)]
    assert verdict_on(panel_of(records)) == expected


def test_of_several_settings_it_is_counted_who_is_best():
    records = paired({"mcl": (20.0, ONE), "deq-mcl": (16.0, ONE)})
    records += paired({"mcl": (20.0, ONE), "deq-mcl": (24.0, ONE)}, scenario="sharp")
    best = "deq-mcl is best in 1 of 2 settings: in 1 no method is confirmed to be better than mcl."
    assert conclusion(results(records)) == best
    worse = paired({"mcl": (20.0, ONE), "deq-mcl": (24.0, ONE)}, scenario="matched")
    few = conclusion(results(records[len(worse) :] + worse))
    assert few == "In none of 2 settings is a method confirmed to be better than mcl."
    assert conclusion(results([])) == "No trial is finished."


def test_of_one_method_in_several_settings_the_ends_are_told_and_nothing_is_compared():
    records = trials("mcl", [20.0] * 3, scenario="a") + trials("mcl", [8.0] * 3, scenario="b")
    said = conclusion(results(records))
    assert said == "2 settings, nothing to compare in them: 8.00 px in b to 20.0 px in a."


def test_a_plug_in_is_in_the_verdict_whoever_is_best():
    own = "./file.py:Mine"
    records = paired({"mcl": (20.0, ONE), "a": (16.0, ONE), own: (24.0, ONE)})
    assert verdict_on(panel_of(records)).endswith(" Plug-in Mine: 24.0 px, worse.")
    records += paired({"mcl": (20.0, ONE), own: (24.0, ONE)}, scenario="sharp")
    assert conclusion(results(records)).endswith(" Plug-in Mine: worse in 2 of 2.")


def test_scenarios_of_files_are_named_by_their_stems_where_these_differ():
    def titles(*scenarios):
        records = [one for name in scenarios for one in trials("mcl", [1.0], scenario=name)]
        return [panel.title for panel in panels(records)]

    assert titles("/far/hall.toml", "/far/own.py:Room") == ["scenario hall", "scenario Room"]
    assert file_words(["a b", "a-b-1"]) == ["a-b-2", "a-b-1"]  # no file of another
    assert titles("/a/hall.toml", "/b/hall.toml") == [f"scenario {one}/hall.toml" for one in "ab"]


def on_a_log(errors, coverage, successes=(1.0, 1.0), runs=12, judged=9):
    """Runs of two methods: their median errors, m, their coverage and successes."""
    records = []
    still = [0.0] * (report_cases.STEPS + 1)
    for k, name in enumerate(("mcl", "amcl")):
        track = RecordedTrack(best=(still, still, still), scores={"coverage_95": coverage[k]})
        for world in range(runs):
            scores = {"success_1m": successes[k], "position_median": errors[k]}
            place = {"judged": judged} if judged else {}
            setting = {"assumed": {"scan.power": 0.1}, "world": place}
            one = report_cases.whole(finished(name, world, 1.0, **setting), scores, 9.0)
            records.append(report_cases.changed(one, track=track))
    return verdict_on(panel_of(records))


def test_on_a_log_successes_then_errors_then_coverage_decide_and_who_is_not_fitted_is_named():
    unfitted = "amcl has Nav2's defaults, while the motion noise"
    told = on_a_log((0.2, 0.1), (0.9, 0.9), (0.0, 1.0))
    assert told.startswith("amcl is best: localized to the end in 100 % of runs")
    assert unfitted in told
    told = on_a_log((0.1, 0.2), (0.9, 0.9), (1.0, 0.0))
    assert told.startswith("No method is better than the baseline, mcl: localized to the end in")
    assert "Worse: amcl." in told
    told = on_a_log((0.2, 0.1), (0.9, 0.5))
    assert told.startswith("amcl is nearest to the reference: median position error of a run, mean")
    assert "amcl 0.100 m, mcl 0.200 m; amcl - mcl: −0.100 m (−0.100 to −0.100)" in told
    told = on_a_log((0.2, 0.2), (0.9, 0.5))
    assert told.startswith("Neither successes nor errors separate the methods, but the 95 % region")
    assert "90 % of mcl's records, 50 % of amcl's records" in told
    assert unfitted not in on_a_log((0.2, 0.2), (0.9, 0.5), judged=None)  # the power was given
    for alike in ((0.9, 0.5), (0.9, 0.9)):  # one run separates nothing
        told = on_a_log((0.1, 12.5), alike, (1.0, 0.0), runs=1)
        assert told.startswith("1 run each cannot decide: give --seeds 7 or more.")
    few = on_a_log((0.2, 0.2), (0.9, 0.5), runs=5)
    assert few.startswith("5 runs each cannot decide: give --seeds 7 or more.")
    told = on_a_log((0.2, 0.2), (0.9, 0.9))
    assert told.startswith("No method is better than the baseline, mcl: ")
