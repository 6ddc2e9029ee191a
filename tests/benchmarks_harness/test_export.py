"""A sweep for a paper: LaTeX that compiles, figures in PDF, BibTeX of what CITATION.cff says."""

import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from report_cases import THREE, paired, results, trials

from benchmarks.report.page import escaped, latex_files, pdf_files
from deqmcl_gym import __version__

CITATION = yaml.safe_load((Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8"))


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
