"""Names of methods and what they mean, states, numbers, intervals and tables as text."""

import math
import re
from collections.abc import Collection, Sequence
from itertools import count

from benchmarks.tables.stats import Interval

BASELINE = "mcl"  # localizer that others are compared with, unless a sweep says otherwise


def short_name(name: str) -> str:
    """A name for readers: a plug-in's class, or the file of a scenario, without the path to it."""
    return name.rsplit(":", 1)[-1].replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")


def short_names(names: Collection[str]) -> dict[str, str]:
    """Names for readers; those that share a short name have as much of the path as differs."""
    short = {name: short_name(name) for name in names}
    paths = {name: name.replace("\\", "/").split("/") for name in names}
    for name, path in paths.items():
        rivals = [p for n, p in paths.items() if n != name and short_name(n) == short[name]]
        if rivals:
            parts = next(n for n in count(1) if all(rival[-n:] != path[-n:] for rival in rivals))
            short[name] = "/".join(path[-parts:])
    return short


def state_name(offset: int) -> str:
    """x_t, x_{t-20}, … in plain characters."""
    return f"x[t{offset:+d}]" if offset else "x[t]"


def fixed(value: float, digits: int = 2) -> str:
    """A number, or n/a."""
    return "n/a" if math.isnan(value) else f"{value:.{digits}f}"


def file_words(labels: Sequence[str]) -> list[str]:
    """Return a name of a file for each label, all different; a label that may be one is its own."""
    words = [re.sub(r"[^\w.-]+", "-", label).strip("-.") for label in labels]
    taken = {*words} & {*labels}
    for place, label in enumerate(labels):
        if words[place] != label:
            numbered = (f"{words[place]}-{number}" for number in count(place + 1))
            words[place] = next(word for word in numbered if word not in taken)
            taken.add(words[place])
    return words


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent, or n/a."""
    return "n/a" if math.isnan(share) else f"{100 * share:.{digits}f} %"


def estimated(value: Interval, form: str = ".2f", unit: str = "") -> str:
    """A mean and its interval, if it has one, of the same digits, with a true minus; or n/a.

    With a ``form`` of "+.2f" the sign of the mean is to be seen; the unit stands behind it.
    """
    if math.isnan(value.mean):
        return "n/a"
    ends = "" if math.isnan(value.low) else f" ({interval(value, form.removeprefix('+'))})"
    return f"{value.mean:{form}}{unit}".replace("-", "−") + ends


def interval(value: Interval, form: str = ".2f") -> str:
    """The ends of an interval."""
    return f"{value.low:{form}} to {value.high:{form}}".replace("-", "−")


def rounded(value: float, digits: int = 3) -> str:
    """A number with this many significant digits, without an exponent."""
    if math.isnan(value):
        return "n/a"
    places = digits - 1 - math.floor(math.log10(abs(value))) if value else 0
    return f"{round(value, places):.{max(places, 0)}f}".replace("-", "−")


def p_value(p: float) -> str:
    """A p-value with two digits."""
    if math.isnan(p):
        return "n/a"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"
