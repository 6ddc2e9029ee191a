"""Tables and numbers as text."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any


def csv_text(header: Sequence[str], lines: Iterable[Iterable[Any]]) -> str:
    """Return a table as CSV; None and NaN are empty cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for line in lines:
        writer.writerow("" if _missing(value) else value for value in line)
    return out.getvalue()


def fixed(value: float, digits: int = 2) -> str:
    """A number, or n/a."""
    return "n/a" if math.isnan(value) else f"{value:.{digits}f}"


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent, or n/a."""
    return "n/a" if math.isnan(share) else f"{100 * share:.{digits}f} %"


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))
