"""report.html, one page without network and scripts, and results.md, the same for a repository."""

import json
import re
from base64 import b64encode
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchmarks.pictures import styled
from benchmarks.report import tables, tracks
from benchmarks.report.animations import IMAGES, Animation, films, paper_figures
from benchmarks.report.charts import STYLE, Chart
from benchmarks.report.frames import PanelFrames, frames_of, validity_frame
from benchmarks.report.panel_charts import panel_charts, swept_charts
from benchmarks.report.tables import Table
from benchmarks.report.verdict import baseline_of, conclusion, progress, verdict
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import BLIND
from benchmarks.tables.text import WORDS, short_name
from benchmarks.trials.scores import GROUPS
from deqmcl_gym.files import command_line, utf8

_PICTURED = 8  # panels with pictures; the tables are of all
_FEW = 20  # worlds below which an interval is called rough
_MARKS = str.maketrans({c: f"\\{c}" for c in "\\`*_[]<>|#"})


class Part(NamedTuple):
    """A heading with how to read it, its tables and charts; closed until clicked if folded."""

    heading: str
    note: str = ""
    tables: Sequence[Table] = ()
    charts: Sequence[Chart] = ()
    folded: bool = False


class Section(NamedTuple):
    """A panel: its verdict, its first table, further parts, films of three worlds."""

    panel: PanelFrames
    verdict: str
    table: Table | None
    parts: list[Part]
    films: list[Animation]
    no_films: str


def parts_of(panel: PanelFrames, *, pictured: bool = True) -> list[Part]:
    """Return what stands below the first table of a panel: the list to add to."""
    parts = [Part(*one) for one in tracks.parts_of(panel)]
    if panel.ranked["score"].notna().any():
        for group in GROUPS:
            heading, _ = tables.WORDS[group.name]
            parts.append(Part(heading, tables=_known(tables.journey_table(panel, group))))
        parts += [
            Part("", charts=panel_charts(panel) if pictured else ()),
            Part("Against the paper's methods", tables=tables.rival_tables(panel), folded=True),
            Part("Optimality gap", tables=_known(tables.gap_table(panel))),
            Part("Calibration", tables=_known(tables.calibration_table(panel))),
            Part(
                "Does the quality detect large errors?",
                tables=_known(tables.detection_table(panel)),
            ),
            Part("Lost, or is the map wrong here?", tables=_known(tables.told_apart_table(panel))),
            Part("Errors at every offset", tables=_known(tables.offsets_table(panel)), folded=True),
        ]
    return [part for part in parts if part.tables or part.charts]


def page_files(
    results: Results,
    folder: Path,
    *,
    draw: bool = False,
    notes: Sequence[str] = (),
    warnings: Sequence[str] = (),
    facts: Sequence[str] = (),
    more: Sequence[Part] = (),
) -> dict[str, bytes]:
    """Return report.html, results.md and the pictures of the latter by name.

    Args:
        results: what it is about.
        folder: whose films and figures are shown, if it has them.
        draw: whether to draw the films that it has not.
        notes, warnings, facts: further sentences; facts stand below, beside the command.
        more: parts of the first section.
    """
    panels = frames_of(results)
    several = len(panels) > 1
    with styled(STYLE), films(panels, folder, draw=draw) as shown:
        sections = [_section(panel, several=several, more=more) for panel in panels]
        swept = swept_charts(panels)
        charts = [chart for one in sections for part in one.parts for chart in part.charts]
        drawn = {chart.name: chart.drawn("svg") for chart in (*swept, *charts)}
        pictures, no_films = shown()
    if sections:
        sections[0] = sections[0]._replace(films=pictures, no_films=no_films)
    figures = paper_figures(folder)
    methods = dict.fromkeys(name for panel in panels for name in panel.rows["method"])
    glances = [tables.glance_table(panels)] if several else []
    glances += _known(tables.detection_glance(panels)) if several else []
    glances += _known(tables.validity_table(validity_frame(results))) if several else []
    telling = {
        "results": results,
        "conclusion": conclusion(results),
        "progress": progress(results),
        "baseline": baseline_of(panels, results),
        "methods": [f"{n} ({WORDS[n]})" if n in WORDS else short_name(n) for n in methods],
        "agents": list(dict.fromkeys(name for panel in panels for name in panel.agents)),
        "worlds": sorted({int(n) for panel in panels for n in panel.rows["worlds"]}),
        "filter_seeds": len({record.trial.filter_seed for record in results.records}),
        "params": panels[0].shared_params if panels else {},
        "blind": any((panel.present["method"] == BLIND).any() for panel in panels),
        "few": _FEW,
        "notes": notes,
        "warnings": warnings,
        "facts": facts,
        "glances": glances,
        "swept": swept,
        "sections": sections,
        "pictured": _PICTURED,
        "figures": figures,
        "failed": tables.failed_table(results),
        "left_out": tables.left_out_table(results),
        "command": command_line(results.command),
        "environment": json.dumps(results.environment, indent=2),
        "drawn": drawn,
        "images": IMAGES,
    }
    engine = _engine()
    pages = {name: engine.get_template(f"{name}.jinja") for name in ("page.html", "results.md")}
    contents = {
        "report.html": utf8(pages["page.html"].render(telling)),
        "results.md": utf8(pages["results.md"].render(telling)),
    }
    contents |= {f"{IMAGES}/{name}.svg": svg for name, svg in drawn.items()}
    contents |= {f"{IMAGES}/{film.name}.webp": film.webp for film in pictures}
    contents |= {f"{IMAGES}/{film.name}.png": film.png for film in pictures}
    return contents | {f"{IMAGES}/{figure.name}": figure.content for figure in figures}


def _known(one: Table | None) -> list[Table]:
    return [] if one is None else [one]


def plain(text: str) -> str:
    """The text on one line, with nothing in it that Markdown reads as a mark."""
    return " ".join(text.split()).translate(_MARKS)


def fenced(text: str) -> str:
    """Return text as a code block that it cannot end."""
    fence = "`" * max([3, *(1 + len(run) for run in re.findall("`+", text))])
    return f"{fence}\n{text}\n{fence}"


def _section(panel: PanelFrames, *, several: bool, more: Sequence[Part]) -> Section:
    scored = bool(panel.ranked["score"].notna().any())
    return Section(
        panel=panel,
        verdict=verdict(panel) if several else "",
        table=tables.verdict_table(panel) if scored else None,
        parts=parts_of(panel, pictured=panel.number <= _PICTURED) + [*more] * (panel.number == 1),
        films=[],
        no_films="",
    )


def _engine() -> Environment:
    engine = Environment(
        autoescape=lambda name: "html" in (name or ""),
        loader=PackageLoader("benchmarks", "report"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    engine.filters["base64"] = lambda content: b64encode(content).decode()
    engine.filters |= {"plain": plain, "fenced": fenced}
    engine.filters["table"] = lambda table: Markup(table.html)  # its cells are escaped
    engine.filters["github"] = lambda table: table.text("github", plain, "**{}**")
    engine.globals["css"] = Markup((files(__package__) / "page.css").read_text(encoding="utf-8"))
    return engine
