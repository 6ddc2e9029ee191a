"""``--fail-if``: which limits are broken, and by what rows."""

import math

import pandas as pd
import pytest
from refusals import refused

from benchmarks.report.runs import LimitError, limits_of, within

TABLE = pd.DataFrame(
    {
        "localizer": ["mcl", "amcl (a)", "amcl (b.2)"],
        "position_p95": [0.1, 0.2, math.nan],
        "metres_to_localize": [3.0, math.inf, 2.0],
        "position_median_diff": [math.nan, 0.02, -0.01],
    }
)


@pytest.mark.parametrize(
    ("words", "rows"),
    [
        ("position_p95 > 0.2", ["amcl (b.2) has an unknown value (position_p95 > 0.2)"]),
        ("amcl (a).position_p95 >= .2", ["amcl (a) has 0.2"]),
        ("mcl.position_p95<0.05", []),
        ("amcl (b.2).position_p95 < 9", ["amcl (b.2) has an unknown value"]),
        ("metres_to_localize > 1e3", ["amcl (a) has inf"]),
        ("position_median_diff > 0.01", ["amcl (a) has 0.02"]),
        ("mcl.position_median_diff > 0.01", ["mcl has an unknown value"]),
    ],
)
def test_a_row_beyond_a_limit_or_unknown_is_told_after_the_output(capsys, words, rows):
    limits = [words, "mcl.position_p95 > 5"]
    if not rows:
        assert within("text", TABLE, limits, "mcl") == "text"
        return
    with pytest.raises(LimitError) as raised:
        within("text", TABLE, limits, "mcl")
    told = str(raised.value).removeprefix("beyond --fail-if: ").split("; ")
    assert [one.startswith(row) for one, row in zip(told, rows, strict=True)] == [True] * len(rows)
    assert capsys.readouterr().out == "text\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("position_p59 > 0.2", "did you mean 'position_p95'?"),
        ("position_p95 > much", "'position_p95 > much'"),
        ("position_p95 = 0.2", "one of >, <, >=, <="),
        ("acml.position_p95 > 0.2", "did you mean 'amcl'?"),
    ],
)
def test_what_is_no_limit_is_refused(words, told):
    with refused(told):
        limits_of([words], ["mcl", "amcl"])
