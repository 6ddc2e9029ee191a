"""The reports as rows, and how texts write their numbers."""

import csv
import functools
import io
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

Cells = list[str]


class Number(float):
    """A number as texts write it: − for minus, "never" for infinity; ``.0p`` is per cent."""

    def __format__(self, spec: str) -> str:
        if math.isinf(self):
            return "never"
        text = f"{100 * self:{spec[:-1]}f}" if spec.endswith("p") else f"{float(self):{spec}}"
        if not text.strip("-0."):  # no minus before what rounds to zero
            text = text.replace("-", "+" if "+" in spec else "")
        return text.replace("-", "−")


def plain(text: str) -> str:
    """Return a text with a hyphen for each minus."""
    return text.replace("−", "-")


def filled(template: str, row: Mapping[str, str]) -> str:
    """Return a template with a row's numbers; "" if the row lacks one."""
    names = re.findall(r"{(\w+)", template)
    if any(row.get(name, "") == "" for name in names):
        return ""
    text = template.format_map({name: Number(row[name]) for name in names})
    return text.replace(" (never to never)", "")


@functools.cache
def read(report: str) -> list[dict[str, str]]:
    """Return the rows of a report, as of ``docs/reports/{report}.csv``."""
    with (ROOT / "docs" / "reports" / f"{report}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rows_where(
    report: str, where: Mapping[str, object], offset: int = 0
) -> Iterator[dict[str, str]]:
    """Yield the rows of a report at an offset, if it has several, where columns have these values.

    Overrides of the world, and of what is assumed of it, count as columns.
    """
    for row in read(report):
        said = row | _parts(row, "world") | _parts(row, "assumed")
        if row.get("offset", "0") == str(offset) and where.items() <= said.items():
            yield row


def row(
    report: str, scenario: str, method: str, particles: int | None = None, offset: int = 0,
    where: Mapping[str, object] | None = None, **params: object,
) -> dict[str, str]:  # fmt: skip
    """Return the row of a report for a method with these parameters, and the fewest others.

    None is a parameter that it may not have; ``where``: see ``rows_where``.
    """

    def given(row: Mapping[str, str]) -> dict[str, object]:
        return {"particles": particles} | _parts(row, "swept") | _parts(row, "params")

    wanted = params | ({} if particles is None else {"particles": particles})
    place = {"scenario": scenario, **(where or {})}
    found = [
        r
        for r in rows_where(report, {"method": method} | place, offset)
        if all(given(r).get(name) == value for name, value in wanted.items())
    ]
    if not found:
        raise LookupError(f"{report}.csv has no {method} {wanted} in {place}")
    return min(found, key=lambda r: len(r["params"]))


def _parts(row: Mapping[str, str], column: str) -> dict[str, object]:
    """Return the named parts in a column; none of a report without it."""
    return json.loads(row.get(column) or "{}")


def table(head: str, rows: Iterable[Cells]) -> str:
    """Return a table; a head that ends with ``:`` is of numbers."""
    heads = [cell.strip() for cell in head.split("|")]
    line = "|".join("---:" if cell.endswith(":") else "---" for cell in heads)
    lines = [[cell.removesuffix(":") for cell in heads], *rows]
    text = ["| " + " | ".join(cells) + " |" for cells in lines]
    text.insert(1, f"|{line}|")
    return "".join(re.sub(r"(?<=\|)  (?=\|)", " ", line) + "\n" for line in text)


def in_bold(cells: Cells, *which: int) -> Cells:
    """Return cells with those of these numbers in bold."""
    return [f"**{cell}**" if k in which else cell for k, cell in enumerate(cells)]


ROBOT = {"laser_model_type": "robot"}
AMCL, OWN = "`amcl`, Nav2's", "`amcl`, the models of all others"
SHARE = "{%s:.0p} %% ({%s_low:.0p} to {%s_high:.0p})"
SUCCESS = SHARE.replace("%s", "success_1m").replace("%%", "%")
RECOVERED = SHARE.replace("%s", "recovered").replace("%%", "%")
ARRIVED = SHARE.replace("%s", "success").replace("%%", "%")
METRES = "{metres_to_localize:.1f} ({metres_to_localize_low:.1f} to {metres_to_localize_high:.1f})"
DIFF_METRES = (
    "{metres_to_localize_diff:+.1f} "
    "({metres_to_localize_diff_low:.1f} to {metres_to_localize_diff_high:.1f})"
)
DIFF = "{diff:+.1f} ({diff_low:.1f} to {diff_high:.1f})"
INTERVAL = "{diff:+.2f} [{diff_low:+.2f}, {diff_high:+.2f}]"
DRAWS = {"start_draws": 20}


def csv_text(header: Sequence[str], lines: Iterable[Iterable[Any]]) -> str:
    """Return a table as CSV; None and NaN are empty cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for line in lines:
        writer.writerow("" if isinstance(v, float) and math.isnan(v) else v for v in line)
    return out.getvalue()
