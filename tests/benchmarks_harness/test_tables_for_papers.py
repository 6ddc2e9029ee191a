"""Table 1 with the paper's values; trials.csv, timings.csv; LaTeX, PDF and BibTeX for a paper."""

import math
import re
from pathlib import Path

import deqmcl_command
import pytest
import report_cases
import yaml
from hypothesis import given
from hypothesis import strategies as st
from report_cases import THREE, changed, finished, paired, parsed, results, table_of, trials

import localizers
from benchmarks.report.page import escaped, latex_files, pdf_files
from benchmarks.report.tables import table_1
from benchmarks.tables.frames import csv_of, timings_table
from deqmcl_gym import __version__

ROOT = Path(__file__).parents[2]
PRINTED = {  # typed from Table 1 of the paper: error, SD, entropy, variances of x, y, cos θ, sin θ
    "deq-mcl": ("20.95 (17.66)", "7.82", "419.92", "290.04", "0.09", "0.07"),
    "mcl-smoother": ("22.88 (20.01)", "8.88", "977.39", "611.06", "0.14", "0.11"),
    "mcl-map": ("25.00 (18.38)", "9.69", "792.28", "616.85", "0.17", "0.16"),
    "mcl": ("26.17 (22.00)", "9.81", "966.93", "591.79", "0.19", "0.16"),
}
UNPRINTED = ("mcl-map-smoother", "dead-reckoning", "somebodys-plug-in")
PAPER = (4, 6, 9, 11, 13, 15)  # columns
CITATION = yaml.safe_load((Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8"))


def lines(*records):
    return table_1(table_of(records), variances=True).frame.to_numpy().tolist()


@pytest.mark.parametrize("offset", [0, -20, 20])
@pytest.mark.parametrize("method", [*PRINTED, *UNPRINTED])
def test_the_papers_printed_values_stand_beside_ours_and_no_others(method, offset):
    *_, cells = lines(finished(method, 0, {0: 1.0, offset: 123.456}))
    nothing = ("",) * len(PAPER)
    expected = PRINTED.get(method, nothing) if offset <= 0 else nothing
    assert tuple(cells[i] for i in PAPER) == expected
    assert cells[3] == "123.46 (n/a)"


def test_our_values_are_rounded_and_named():
    scores = {"entropy": 9.876, "var_x": 1000.04, "var_cos": 0.1234, "wall_share": 0.0456}
    made = trials("mcl", [1.0, 2.0, 6.0], scores=scores)
    mcl, _, past = lines(*made, *trials("mcl-map", [2.0, 3.0, 7.0], offsets=(0, -20)))
    assert mcl[:4] == ["mcl", "x[t]", "baseline", "3.00 (2.65)"]
    assert (mcl[5], mcl[7], mcl[8], mcl[12]) == ("9.88", "4.6 %", "1000.0", "0.123")
    assert past[:3] == ["mcl-map", "x[t-20]", "+1.00 (1.00 to 1.00)"]


def test_what_is_unknown_reads_na_and_a_difference_without_interval_stands_alone():
    unknown = {"entropy": None, "wall_share": None}
    theirs = finished("x", 0, {0: 3.5, -20: None}, scores=unknown)
    _, now, past = lines(finished("mcl", 0, 5.0), theirs)
    assert (now[2], now[5], now[7]) == ("−1.50", "n/a", "n/a")
    assert (past[2], past[3]) == ("n/a", "n/a (n/a)")


def test_in_a_terminal_no_line_of_any_method_of_ours_is_longer_than_120_columns():
    rows = table_of(paired(dict.fromkeys(localizers.names(), (1234.5, (0, -20, 20)))))
    text = table_1(rows).text().splitlines()
    assert max(map(len, text)) <= 120
    assert text[0].split()[:5] == ["method", "of", "error", "-", "mcl's,"]


def test_trials_csv_has_a_line_per_trial_and_offset_with_its_counts():
    counted = finished("mcl", 4, 7.5, scores={"entropy": None}, params={"beta": math.inf})
    counted = changed(counted, events={"replanned_steps": 3})
    other = finished("deq-mcl", 4, {0: 1.0, -20: 2.0}, filter_seed=1)
    first, *rest = parsed(report_cases.trials_csv([counted, other]))
    expected = {"method": "mcl", "params": '{"beta":"inf"}', "trial": "4", "filter_seed": "0"}
    expected |= {"scenario": "paper", "offset": "0", "error": "7.5", "lag": "20"}
    assert {name: first[name] for name in expected} == expected
    assert (first["entropy"], first["steps_done"], first["scans_used"]) == ("", "60", "60")
    assert (first["replanned_steps"], first["weight_collapses"]) == ("3", "")
    assert [(line["offset"], line["error"]) for line in rest] == [("0", "1.0"), ("-20", "2.0")]
    assert {line["filter_seed"] for line in rest} == {"1"}


def test_timings_csv_has_a_line_per_trial_in_seconds_and_milliseconds_per_step():
    timed = [changed(finished("mcl", 0, 1.0), seconds=seconds) for seconds in (0.3, None)]
    lines = parsed(csv_of(timings_table(timed)))
    assert [(line["seconds"], line["ms_per_step"]) for line in lines] == [("0.3", "5.0"), ("", "")]


def test_the_papers_values_in_the_reports_are_those_printed():
    for row in deqmcl_command.lines(ROOT / "docs/reports/paper/printed", "table1.csv"):
        error, *others = PRINTED[row["method"]]
        assert f"{row['error']} ({row['error_sd']})" == error
        names = ("entropy", "var_x", "var_y", "var_cos", "var_sin")
        assert [row[name] for name in names] == others


@pytest.fixture(scope="module")
def latex():
    files = latex_files(results(paired(THREE), title="Sweep 100 % & more_$"))
    return {name: content.decode("ascii") for name, content in files.items()}


@given(st.text())
def test_any_text_is_ascii_in_which_no_sign_has_a_meaning(text):
    done = escaped(text)
    assert done.isascii()
    commands = r"\\(?:text\w+\{\}|dots\{\}|[&%$#_{}])|\{[][]\}"
    commands += r"|\$-\$|\$(?:\\\w+|\^\\circ|\\frac\{1\}\{2\})\$"
    assert not re.search(r"[\\{}$&#^_%]", re.sub(commands, "", done))
    # as in \\[1cm], where a table's line begins with a name of other letters than ASCII
    assert not re.search(r"(?<!\{)\[|\](?!\})", done)


def test_the_best_method_stands_first_in_bold_and_the_baseline_is_named(latex):
    first, second, third = re.findall(r"^(.*) \\\\$", latex["tables.tex"], re.MULTILINE)[1:]
    assert first.startswith(r"\textbf{deq-mcl} & \textbf{16.")
    assert second.startswith("mcl (baseline) & 20.")
    assert third.startswith(r"\textless{}b\textgreater{}\&Mine\$x\$ (plug-in) & 24.")


def test_of_several_settings_the_first_table_is_all_of_them_and_captions_are_short():
    both = paired(THREE) + paired(THREE, scenario="sharp")
    text = latex_files(results(both))["tables.tex"].decode("ascii")
    first, *others = re.findall(r"\\begin\{tabular\}.*?\\end\{tabular\}", text, re.DOTALL)
    assert "1. paper & 20." in first
    assert "2. sharp & 20." in first
    assert r"$\blacktriangle" in first
    assert len(others) == 2
    captions = re.findall(r"\\caption\{(.*)\}", text)
    assert [len(one.split()) < 40 for one in captions] == [True] * 3


def test_the_bibliography_is_that_of_the_citation_file(latex):
    text = re.sub("[{}]", "", latex["references.bib"])
    paper = CITATION["references"][0]
    for said in (CITATION["title"], __version__, paper["title"], str(paper["year"])):
        assert said in text
    assert str(CITATION["date-released"])[:4] in text
    assert all(author["family-names"] in text for author in paper["authors"])


def test_the_figures_are_pdf_of_which_the_same_results_give_the_same_bytes():
    made = trials("mcl", [1.0, 2.0]) + trials("a", [2.0, 3.0], offsets=(0, -20))
    given_results = results(made + trials("far", [90.0, 91.0], offsets=(0, -20)))
    files = pdf_files(given_results)
    assert {"figures/points-1.pdf", "figures/offsets-1.pdf"} <= files.keys()
    assert pdf_files(given_results) == files
    assert all(content.startswith(b"%PDF-") for content in files.values())
    assert b"/Subtype /Image" not in b"".join(files.values())  # vectors
