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
_FORM = re.compile(r"\s*(?:(.+)\.)?(\w+)\s*([<>]=?)\s*([-+.\w]+)\s*")


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
        rows = table.set_index("localizer")[self.column]
        if self.row:
            rows = rows.loc[[self.row]]
        elif self.column in COMPARISONS:  # the baseline is compared with nothing
            rows = rows.drop(baseline, errors="ignore")
        return [
            f"{name} has {self.column} {'unknown' if math.isnan(value) else f'{value:.4g}'} "
            f"({self.words})"
            for name, value in rows.items()
            if math.isnan(value) or _COMPARE[self.compare](value, self.value)
        ]


def limits_of(texts: Sequence[str]) -> list[Limit]:
    """Read limits ``[ROW.]COLUMN > NUMBER``."""
    limits = []
    for text in texts:
        parts = _FORM.fullmatch(text)
        try:
            row, column, compare, number = parts.groups() if parts else ("", "", "", "")
            limits.append(Limit(text.strip(), row or "", column, compare, float(number)))
        except ValueError:
            raise InputError(
                f"--fail-if is {shown(text)}, but must be a column of results.csv, one of "
                f"{', '.join(_COMPARE)}, and a number, as in 'position_p95 > 0.2' or "
                "'amcl.position_p95 > 0.2'."
            ) from None
        one_of("column of --fail-if", column, NUMBERS)
    return limits


def check_rows(limits: Sequence[Limit], rows: Collection[str]) -> None:
    """Refuse a limit of a row that there is not."""
    for limit in limits:
        if limit.row:
            one_of("row of --fail-if", limit.row, rows)


def within(text: str, table: pd.DataFrame, limits: Sequence[Limit], baseline: str = "") -> str:
    """Return what a command prints at its end; print it and raise if a row is beyond a limit."""
    check_rows(limits, [*table["localizer"]])
    if broken := [words for limit in limits for words in limit.broken(table, baseline)]:
        print(text)
        raise LimitError(f"beyond --fail-if: {'; '.join(broken)}.")
    return text
