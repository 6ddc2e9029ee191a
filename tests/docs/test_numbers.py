"""The numbers of README and docs are those of the reports: ``make docs-numbers`` writes them."""

import importlib.util

import pytest
from test_links import ROOT

spec = importlib.util.spec_from_file_location("numbers_of_docs", ROOT / "docs" / "numbers.py")
numbers = importlib.util.module_from_spec(spec)
spec.loader.exec_module(numbers)

PAGES = {page.relative_to(ROOT).as_posix(): page.read_text("utf-8") for page in numbers.pages()}
MARKED = [page for page, text in PAGES.items() if numbers.MARKER.search(text)]


@pytest.mark.parametrize("page", MARKED)
def test_every_table_below_a_marker_has_the_numbers_of_the_reports(page):
    assert numbers.renewed(PAGES[page]) == PAGES[page]


@pytest.mark.parametrize(("page", "sentence"), list(numbers.sentences()))
def test_a_sentence_has_the_numbers_of_the_reports(page, sentence):
    assert sentence in PAGES[page]


def test_every_table_has_one_place():
    markers = [found[2] for text in PAGES.values() for found in numbers.MARKER.finditer(text)]
    assert sorted(markers) == sorted(numbers.TABLES)


def test_a_number_of_the_texts_that_is_changed_is_found():
    text = PAGES["README.md"]
    assert numbers.renewed(text.replace("11.1 (3.3)", "11.0 (3.3)")) == text
