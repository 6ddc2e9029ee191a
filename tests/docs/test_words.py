"""The documents can be read in an afternoon: how many words they may have, as ``wc -w`` counts."""

import re

import pytest
from test_links import DOCUMENTS, ROOT

REPORTS = ROOT / "docs" / "reports"
MOST = {"README.md": 1000, "CONTRIBUTING.md": 1000, "CHANGELOG.md": 1500, "docs/decisions.md": 3500}
PAGES = [
    path
    for path in DOCUMENTS
    if path.relative_to(ROOT).as_posix() not in MOST and REPORTS not in path.parents
]


def words(path):
    return len(path.read_text(encoding="utf-8").split())


@pytest.mark.parametrize(("name", "most"), MOST.items())
def test_a_document_is_short(name, most):
    assert words(ROOT / name) <= most


def test_all_pages_together_are_an_afternoon():
    assert sum(map(words, PAGES)) <= 36_000


def test_a_decision_is_told_in_150_words():
    sections = re.split("^## ", (ROOT / "docs" / "decisions.md").read_text(), flags=re.MULTILINE)
    assert len(sections) > 20
    assert max(len(section.split()) for section in sections) <= 150
