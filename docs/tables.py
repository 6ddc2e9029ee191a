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
tables are of the code: ``<!-- parameters: mcl-plan -->``, ``<!-- arguments: Room-v0 -->``,
``<!-- ids -->``; see ``OF_CODE``.
"""

import inspect
import json
import math
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from numbers import Real
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
REPORTS = ROOT / "docs" / "reports"
MARKER = re.compile(r"(<!-- (\w+)(?:[:\n]| (?=-->))((?:(?!-->)[\s\S])*)-->\n)((?:\|.*\n)*)")
_JSON = "params", "world", "assumed", "swept"  # columns whose parts become columns of their own
OF_CODE: dict[str, Callable[..., str]] = {}  # by the word of their marker


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
        if file is not None and (found := re.match(file, Path(name).stem)):
            frame = frame.assign(**found.groupdict(""))
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
            for own in reversed(group.to_dict("records")):  # of several the first stands
                name = own[across] if isinstance(own[across], str) else f"n{own[across]:g}"
                parts = {str(k): _value(v, labels) for k, v in own.items()}
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

    def made(found: re.Match[str]) -> str:
        head, word, content, _ = found.groups()
        if word == "table":
            return head + numbers(**tomllib.loads(content))
        if word not in OF_CODE:
            return found[0]
        return head + OF_CODE[word](*(part.strip() for part in content.split(",") if part.strip()))

    return MARKER.sub(made, text)


def pages() -> list[Path]:
    """Return the pages that may have markers."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def ids() -> str:
    """Return the ids of the environments: what they are, of what arguments, how long they last."""
    import gymnasium as gym

    from deqmcl_gym.registration import ABOUT
    from deqmcl_gym.world.presets import WORLDS

    rows = []
    for name, about in ABOUT.items():
        spec = gym.spec(f"deqmcl_gym/{name}")
        made = dict(spec.kwargs)
        if "preset" in made:
            made = _changes(WORLDS["paper"], WORLDS[made["preset"]])
        given = ", ".join(f"`{part}={_code(value)}`" for part, value in _flat(made))
        arguments = {each: default for each, default, _ in _signature(_class(name))}
        most = spec.max_episode_steps or arguments.get("max_steps") or "none"
        together = "in kernels" if spec.vector_entry_point else "in a loop"
        if "scan" in arguments:
            together = '`scan="field"`'
        rows.append([f"`{name}`", about, given, str(most), together])
    return table(["`deqmcl_gym/…`", "what it is", "set", "most steps", "`make_vec`"], rows)


def arguments(name: str) -> str:
    """Return the arguments of an id, or of a part of it (``Office``), from the code's own words."""
    found = _class(name)
    if is_dataclass(found):
        return table(["key", "default", "meaning"], _keys("", found, found))
    rows = []
    for argument, default, said in _signature(found):
        part, asked = _part(argument) if name == "Room-v0" else (None, True)
        if asked:
            rows.append([f"`{argument}`", f"`{_code(default)}`", said])
        if part is not None:
            rows += _keys(f"{argument}.", type(part), part)
    return table(["argument", "default", "meaning"], rows)


def _class(name: str) -> Any:
    import gymnasium as gym
    from gymnasium.envs.registration import load_env_creator

    import deqmcl_gym

    if "-v" not in name:
        return getattr(deqmcl_gym, name, None) or getattr(deqmcl_gym.maps, name)
    return load_env_creator(str(gym.spec(f"deqmcl_gym/{name}").entry_point))


def _signature(found: type) -> Iterator[tuple[str, Any, str]]:
    """Yield the arguments of a class and of those that it is derived from, with their words."""
    told = set()
    for owner in (one for one in found.__mro__ if one.__module__.split(".")[0] != "gymnasium"):
        words = _words(owner)
        for argument in inspect.signature(owner).parameters.values():
            asked = argument.default is not argument.empty
            if asked and argument.name in words and argument.name not in told:
                told.add(argument.name)
                yield argument.name, argument.default, words[argument.name]


def _words(owner: type) -> dict[str, str]:
    """Return what the docstring of a class says of each argument."""
    section = (inspect.getdoc(owner) or "").partition("Args:\n")[2].partition("\n\n")[0]
    found: dict[str, str] = {}
    for names, words in re.findall(r"^    (\w[\w, ]*): ((?:.*\n?)(?:     .*\n?)*)", section, re.M):
        said = " ".join(words.split()).removesuffix(".").replace("``", "`").replace("|", "or")
        found |= dict.fromkeys(names.split(", "), said)
    return found


def _part(argument: str) -> tuple[Any, bool]:
    """Return a part of the world with its defaults, and whether a world may be without it."""
    from deqmcl_gym.world import config
    from deqmcl_gym.world.presets import WORLDS

    if argument in config._OPTIONAL:
        return config._OPTIONAL[argument](), True
    part = getattr(WORLDS["paper"], argument, None)
    return (None, True) if argument == "floor_plan" or part is None else (part, False)


def _keys(prefix: str, owner: Any, defaults: Any) -> list[list[str]]:
    """Return a row for each field of a dataclass, with the comment ``#:`` above or beside it."""
    source = inspect.getsource(owner)
    lines = re.findall(r"((?:^    #: .*\n)*)^    (\w+): [^\n#]*(?:#: (.*))?$", source, re.M)
    said = {name: " ".join(above.replace("#:", "").split()) or own for above, name, own in lines}
    rows = []
    for own in fields(owner):
        per = own.metadata.get("length", 0)
        unit = {1: " px", -1: " /px"}.get(per, "")
        value = _code(getattr(defaults, own.name))
        words = said[own.name].replace("``", "`")
        rows.append([f"`{prefix}{own.name}`", f"`{value}`{unit if value != 'None' else ''}", words])
    return rows


def _changes(of: Any, to: Any) -> dict[str, Any]:
    """Return what differs between two dataclasses, part by part."""
    found: dict[str, Any] = {}
    for own in fields(of):
        old, new = getattr(of, own.name), getattr(to, own.name)
        if old != new:
            found[own.name] = {} if is_dataclass(new) else new
            if is_dataclass(old) and is_dataclass(new):
                found[own.name] = _changes(old, new)
    return found


def _flat(parts: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in parts.items():
        if name == "floor_plan" or not (isinstance(value, dict) and value):
            yield name, value
        else:
            yield from ((f"{name}.{key}", each) for key, each in value.items())


def _code(value: Any) -> str:
    """Return a value as code; angles as shares of π."""
    share = value / math.pi if isinstance(value, float) else 0.0
    for below in (1, 2, 4, 12):
        if share and math.isclose(share * below, round(share * below), abs_tol=1e-9):
            times = round(share * below)
            return f"{times if times != 1 else ''}π{f'/{below}' if below > 1 else ''}"
    return repr(value).replace("'", '"')


OF_CODE |= {"ids": ids, "arguments": arguments}


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
