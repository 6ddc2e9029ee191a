"""How much there is to hold; ``walks.py`` prints it."""

import pytest
import walks


@pytest.mark.slow
def test_no_walk_enters_more_files_than_its_limit():
    entered = {name: len(files) for name, files in walks.walks().items()}
    assert {name: n for name, n in entered.items() if n > walks.LIMITS[name]} == {}


def test_a_trial_makes_no_more_calls_than_its_limit():
    assert walks.of_a_trial("mcl").calls <= walks.MOST_CALLS


def test_the_source_has_few_files_and_no_import_circle():
    assert len(walks.source()) <= walks.MOST_FILES
    assert walks.circle() == []


def test_source_and_tests_have_no_more_lines_than_their_limits():
    assert {k: n for k, n in walks.lines().items() if n > walks.MOST_LINES[k]} == {}
