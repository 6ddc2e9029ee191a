"""Tables of README and docs, written from the CSV files of ``docs/reports`` and from the code.

``python -m docs.tables`` writes each table below its marker, an HTML comment; ``--check`` names the
pages that differ. A table of numbers says in TOML where they come from::

    <!-- table
    of = "hedge/authors.csv"               # one file of docs/reports or a list of them
    where = "scenario == 'guided'"         # of pandas' query; params_keep is keep in params
    rows = { method = ["mcl-plan", "mcl-map"] }  # which rows, in which order
    labels = { mcl-map = "without a plan" }      # words for values
    [columns]                              # a cell is empty if its report has no such number
    method = "`{method}`"
    "error, px" = "{error:.1f} ({error_low:.1f} to {error_high:.1f})"
    lost = "{lost_rate:.0p}"               # per cent
    -->

``named = { "`mcl-map`" = "method == 'mcl-map'" }`` picks rows one by one instead, in this order,
each with its ``{name}``. A dot in a name of a part is written ``_``: ``world_lidar_beams``.
``file = "(?P<building>intel|willow).*"`` makes columns of parts of a file's name.

With ``by = ["method"]`` and ``across = "scenario"`` a row has several scenarios, and a cell names
them: ``{guided.error:.1f}``; a number is named with an n before it: ``{n300.error:.1f}``. Other
tables are of the code, see ``OF_CODE``: ``<!-- parameters: mcl-plan, deq-mcl -->``, of localizers;
``<!-- arguments: Room-v0 -->``, ``<!-- ids -->``; ``<!-- scores: offset -->``, ``<!-- suites -->``,
``scenarios``, ``agents``, ``laws``.
"""

import json
import math
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from numbers import Real
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd

from docs.tables_of_code import OF_CODE

ROOT = Path(__file__).resolve().parents[1]
REPORTS = ROOT / "docs" / "reports"
MARKER = re.compile(r"(<!-- (\w+)(?::|\s)((?:(?!-->)[\s\S])*)-->\n)((?:\|.*\n)*)")
_JSON = "params", "world", "assumed", "swept"  # columns whose parts become columns of their own


class Number(float):
    """A number as texts write it: − for minus, "never" for infinity; ``.0p`` is per cent."""

    def __format__(self, spec: str) -> str:
        if math.isinf(self):
            return "never"
        percent = spec.endswith("p")
        text = f"{100 * self:{spec[:-1]}f} %" if percent else f"{float(self):{spec}}"
        if not re.search("[1-9]", text):  # no minus before what rounds to zero
            text = text.replace("-", "+" if "+" in spec else "")
        return text.replace("-", "−")


def rows_of(
    files: str | Iterable[str], where: str | None = None, file: str | None = None
) -> pd.DataFrame:
    """Return the rows of reports, the parts of JSON columns as columns ``params_NAME``."""
    frames = []
    for name in [files] if isinstance(files, str) else files:
        frame = pd.read_csv(REPORTS / name, keep_default_na=False, na_values=[""])
        for column in frame.columns.intersection(_JSON):
            parts = pd.json_normalize(frame[column].fillna("").map(_parts).tolist(), max_level=0)
            for dotted in parts.columns[parts.columns.str.contains(".", regex=False)]:
                parts[dotted.replace(".", "_")] = parts[dotted]
            frame = frame.join(parts.add_prefix(f"{column}_"))
        if file is not None and (match := re.match(file, Path(name).stem)):
            frame = frame.assign(**match.groupdict(""))
        frames.append(frame)
    whole = pd.concat(frames, ignore_index=True).copy()  # in one piece
    return whole.query(where, engine="python") if where else whole


def _parts(text: str) -> dict[str, Any]:
    return json.loads(text) if text.startswith("{") else {}


def numbers(
    of: str | list[str],
    columns: Mapping[str, str],
    where: str | None = None,
    rows: Mapping[str, list[Any]] | None = None,
    by: list[str] | None = None,
    across: str | None = None,
    labels: Mapping[str, str] | None = None,
    file: str | None = None,
    named: Mapping[str, str] | None = None,
) -> str:
    """Return a table of numbers: see this module's docstring."""
    frame = rows_of(of, where, file)
    if named:
        picked = (frame.query(q, engine="python").assign(name=name) for name, q in named.items())
        frame = pd.concat(picked, ignore_index=True)
    for name, values in reversed((rows or {}).items()):
        places = frame[name].map({value: place for place, value in enumerate(values)})
        frame = frame[places.notna()].iloc[places.dropna().argsort(kind="stable").to_numpy()]
    if by is None:
        records = [
            {str(k): _value(v, labels) for k, v in r.items()} for r in frame.to_dict("records")
        ]
    else:
        records = []
        for _, group in frame.groupby(by, sort=False, dropna=False):
            first = {name: _value(group.iloc[0][name], labels) for name in by}
            for record in reversed(group.to_dict("records")):  # of several the first stands
                name = record[across] if isinstance(record[across], str) else f"n{record[across]:g}"
                parts = {str(k): _value(v, labels) for k, v in record.items()}
                first[name] = SimpleNamespace(**parts)
            records.append(first)
    return table(columns, ([_filled(cell, r) for cell in columns.values()] for r in records))


def table(heads: Iterable[str], rows: Iterable[list[str]]) -> str:
    """Return a Markdown table; a column in which all begins with a digit is set to the right."""
    lines = [list(row) for row in rows]
    numeric = [
        all(re.match(r"[*+−\d]|never|$", cell) for cell in column)
        for column in zip(*lines, strict=True)
    ]
    rule = "|".join("---:" if right else "---" for right in numeric)
    head, *body = ("| " + " | ".join(line) + " |\n" for line in [list(heads), *lines])
    return head + f"|{rule}|\n" + "".join(re.sub(r"(?<=\|)  (?=\|)", " ", line) for line in body)


def _value(value: Any, labels: Mapping[str, str] | None) -> Any:
    if isinstance(value, str):
        return (labels or {}).get(value, value)
    return Number(value) if isinstance(value, Real) else value


def _filled(template: str, row: Mapping[str, Any]) -> str:
    """Return a template with a row's numbers; "" if the row lacks one."""
    for name, _, part in re.findall(r"{([\w-]+)(\.(\w+))?", template):
        value = row.get(name)
        value = getattr(value, part, None) if part else value
        if value is None or value != value:  # noqa: PLR0124 - NaN
            return ""
    return template.format_map(row).replace(" (never to never)", "")


def renewed(text: str) -> str:
    """Return a page with the table below each of its markers made anew."""

    def made(match: re.Match[str]) -> str:
        head, word, content, _ = match.groups()
        if word == "table":
            return head + numbers(**tomllib.loads(content))
        if word not in OF_CODE:
            return match[0]
        names = (part.strip() for part in content.split(","))
        return head + table(*OF_CODE[word](*filter(None, names)))

    return MARKER.sub(made, text)


def pages() -> list[Path]:
    """Return the pages that may have markers."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def main(words: list[str]) -> int:
    """Write the tables, or only say which pages have others."""
    stale = 0
    for page in pages():
        before = page.read_text(encoding="utf-8")
        try:
            text = renewed(before)
        except Exception as error:
            error.add_note(f"in {page.relative_to(ROOT)}")
            raise
        if text == before:
            continue
        if "--check" in words:
            stale += 1
            print(f"{page.relative_to(ROOT)} has other tables: run python -m docs.tables.")
        else:
            page.write_text(text, encoding="utf-8")
            print(f"written: {page.relative_to(ROOT)}")
    return int(stale > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
