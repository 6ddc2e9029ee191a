"""Names of methods and what they mean, names of states, numbers and tables as text."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any

WORDS = {  # what the names of methods mean; the first four as in the paper's Table 1
    "mcl": "MCL",
    "mcl-smoother": "MCL with smoother",
    "mcl-map": "MCL with map-based motion model",
    "deq-mcl": "DEQ-MCL",
    "mcl-map-smoother": "MCL with map-based motion model and smoother",
    "deq-mcl-rejuvenated": "DEQ-MCL with its future renewed",
    "mcl-h": "mcl-map that looks ahead by a table",
    "mcl-pilots": "mcl-map that looks ahead by roll-outs",
    "mcl-plan": "mcl-map with plans as observations",
    "mcl-plan-hedged": "mcl-plan beside a filter that sees no plan",
    "dead-reckoning": "dead reckoning on the plan",
    "grid": "grid filter",
    "amcl": "Nav2's AMCL",
    "ekf": "extended Kalman filter",
}


def short_name(name: str) -> str:
    """A name for readers: a plug-in's class, or the file of a scenario, without the way to it."""
    return name.rsplit(":", 1)[-1].replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")


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
