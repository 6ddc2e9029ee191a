"""Names of methods and states, numbers, intervals and tables as text."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks.tables.stats import Estimate

PRINTED = {  # in the paper's Table 1
    "deq-mcl": "DEQ-MCL",
    "mcl-smoother": "MCL with smoother",
    "mcl-map": "MCL with map-based motion model",
    "mcl": "MCL",
}
TITLES = PRINTED | {
    "mcl-map": "map-based MCL",
    "mcl-map-smoother": "map-based MCL with smoother",
    "deq-mcl-rejuvenated": "rejuvenated DEQ-MCL",
    "mcl-h": "map-based MCL with tabulated look-ahead",
    "mcl-pilots": "map-based MCL with pilots",
    "mcl-plan": "map-based MCL with the plan as a sensor",
    "mcl-plan-hedged": "map-based MCL with hedged plans",
    "dead-reckoning": "dead reckoning on the plan",
    "grid": "grid filter",
    "amcl": "AMCL",
    "ekf": "EKF",
}


def short_name(name: str) -> str:
    """A name for readers: a plug-in's class, or the file of a scenario, without the way to it."""
    return name.rsplit(":", 1)[-1].replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")


def full_name(localizer: str) -> str:
    """The method's name in words, if it has one."""
    return TITLES.get(localizer, short_name(localizer))


def state_name(offset: int) -> str:
    """x_t, x_{t-20}, … in plain characters."""
    return f"x[t{offset:+d}]" if offset else "x[t]"


def csv_text(header: Sequence[str], lines: Iterable[Iterable[Any]]) -> str:
    """Return a table as CSV; None and NaN are empty cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for line in lines:
        writer.writerow("" if isinstance(v, float) and math.isnan(v) else v for v in line)
    return out.getvalue()


def fixed(value: float, digits: int = 2) -> str:
    """A number, or n/a."""
    return "n/a" if math.isnan(value) else f"{value:.{digits}f}"


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent, or n/a."""
    return "n/a" if math.isnan(share) else f"{100 * share:.{digits}f} %"


def estimated(value: Estimate, form: str = ".2f", unit: str = "") -> str:
    """A mean and its interval, with a true minus; or n/a.

    Args:
        value: the mean, and its interval if it has one.
        form: of the mean, "+.2f" if its sign is to be seen; the ends have its digits.
        unit: behind the mean.
    """
    if math.isnan(value.mean):
        return "n/a"
    ends = "" if math.isnan(value.low) else f" ({interval(value, form.removeprefix('+'))})"
    return f"{value.mean:{form}}{unit}".replace("-", "−") + ends


def interval(value: Estimate, form: str = ".2f") -> str:
    """The ends of an interval."""
    return f"{value.low:{form}} to {value.high:{form}}".replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """A number with this many significant digits, without an exponent."""
    if math.isnan(value):
        return "n/a"
    places = digits - 1 - math.floor(math.log10(abs(value))) if value else 0
    return f"{round(value, places):.{max(places, 0)}f}".replace("-", "−")


def capital(sentence: str) -> str:
    """The sentence with a capital letter."""
    return sentence[:1].upper() + sentence[1:]


def p_value(p: float) -> str:
    """A p-value with two digits."""
    if math.isnan(p):
        return "n/a"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def counted(counts: set[int], one: str) -> str:
    """From the least to the largest count of a thing."""
    if not counts:
        return f"no {one}s"
    low, high = min(counts), max(counts)
    return f"{low} to {high} {one}s" if low < high else f"{low} {one}{'s' * (low != 1)}"
