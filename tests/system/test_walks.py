"""How many files a reader must open to follow a run; ``walks.py`` prints which."""

import pytest
import walks


@pytest.mark.slow
def test_no_walk_enters_more_files_than_its_limit():
    entered = {name: len(files) for name, files in walks.walks().items()}
    assert {name: n for name, n in entered.items() if n > walks.LIMITS[name]} == {}


def test_the_source_has_few_files_and_no_import_circle():
    assert len(walks.source()) <= walks.MOST_FILES
    assert walks.circle() == []
