"""``--fail-if 'position_p95 > 0.2'``: limits on columns of results.csv, as a gate for CI."""

import math
import operator
import re
from collections.abc import Collection, Sequence
from typing import NamedTuple

import pandas as pd

from benchmarks.report.tracks import COMPARISONS, NUMBERS
from deqmcl_gym.validation import InputError, one_of, shown

_COMPARE = {">": operator.gt, "<": operator.lt, ">=": operator.ge, "<=": operator.le}
_FORM = re.compile(r"\s*(?:(.+)\.)?(\w+)\s*([<>]=?)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*")


class LimitError(RuntimeError):
    """A row is beyond a limit, or its value is unknown."""

    exit_code = 4


class Limit(NamedTuple):
    """What no row may be; of one row or, if it is "", of all."""

    words: str
    row: str
    column: str
    compare: str
    value: float

    def broken(self, table: pd.DataFrame, baseline: str) -> list[str]:
        """Say which rows of results.csv it holds for; what is unknown is no pass."""
        values = table.set_index("localizer")[self.column]
        if self.row:
            values = values.loc[[self.row]]
        elif self.column in COMPARISONS:  # the baseline is compared with nothing
            values = values.drop(baseline, errors="ignore")
        beyond = values[values.isna() | _COMPARE[self.compare](values, self.value)]
        return [
            f"{name} has {'an unknown value' if math.isnan(value) else f'{value:.4g}'} "
            f"({self.words})"
            for name, value in beyond.items()
        ]


def limits_of(texts: Sequence[str], rows: Collection[str] | None = None) -> list[Limit]:
    """Read limits ``[ROW.]COLUMN > NUMBER``, of these rows if they are known."""
    limits = []
    for text in texts:
        if (parts := _FORM.fullmatch(text)) is None:
            raise InputError(
                f"--fail-if is {shown(text)}, but must be a column of results.csv, one of "
                f"{', '.join(_COMPARE)}, and a number, as in 'position_p95 > 0.2' or "
                "'amcl.position_p95 > 0.2'."
            )
        row, column, compare, value = parts.groups(default="")
        one_of("column of --fail-if", column, NUMBERS)
        if row and rows is not None:
            one_of("row of --fail-if", row, rows)
        limits.append(Limit(text.strip(), row, column, compare, float(value)))
    return limits


def within(text: str, table: pd.DataFrame, limits: Sequence[str], baseline: str = "") -> str:
    """Return what a command prints at its end; print it and raise if a row is beyond a limit."""
    given = limits_of(limits, [*table["localizer"]])
    if broken := [words for limit in given for words in limit.broken(table, baseline)]:
        print(text)
        raise LimitError(f"beyond --fail-if: {'; '.join(broken)}.")
    return text
