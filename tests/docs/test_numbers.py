"""The numbers of README and docs are those of the reports: ``make docs-numbers`` writes them."""

import pytest
from test_links import ROOT

from docs.numbers import pages

PAGES = {page.relative_to(ROOT).as_posix(): page.read_text("utf-8") for page in pages.pages()}
MARKED = [page for page, text in PAGES.items() if pages.MARKER.search(text)]


@pytest.mark.parametrize("page", MARKED)
def test_every_table_below_a_marker_has_the_numbers_of_the_reports(page):
    assert pages.renewed(PAGES[page]) == PAGES[page]


@pytest.mark.parametrize(("page", "sentence"), list(pages.sentences()))
def test_a_sentence_has_the_numbers_of_the_reports(page, sentence):
    assert sentence in PAGES[page]


def test_every_table_has_one_place():
    markers = [found[2] for text in PAGES.values() for found in pages.MARKER.finditer(text)]
    assert sorted(markers) == sorted(pages.TABLES)


def test_a_number_of_the_texts_that_is_changed_is_found():
    text = PAGES["README.md"]
    assert pages.renewed(text.replace("11.1 (3.3)", "11.0 (3.3)")) == text
