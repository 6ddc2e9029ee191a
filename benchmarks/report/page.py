"""Reports: report.html without network and scripts, results.md, and what a paper needs of them.

A paper needs tables in LaTeX (booktabs), charts in PDF, and BibTeX of what is cited.
"""

import json
import re
from base64 import b64encode
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchmarks.pictures import styled
from benchmarks.report import tables
from benchmarks.report.animations import IMAGES, Animation, films, pictures_of_paper
from benchmarks.report.charts import STYLE, panel_charts
from benchmarks.report.swept import swept_charts
from benchmarks.report.tables import Part, Table
from benchmarks.report.tracks import track_parts
from benchmarks.report.verdict import baseline_words, conclusion, progress, verdict_on
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import Panel
from benchmarks.tables.text import BLIND, WORDS, short_name
from benchmarks.trials.scores import GROUPS
from deqmcl_gym import __version__
from deqmcl_gym.files import command_line, utf8

_PICTURED = 8  # panels with pictures; the tables are of all
_FEW = 20  # worlds below which an interval is called rough
_MARKS = str.maketrans({c: f"\\{c}" for c in "\\`*_[]<>|#"})
_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
        "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''",
        **{char: f"\\{char}" for char in "&%$#_{}"},
        "−": "$-$", "×": r"$\times$", "–": "--", "…": r"\dots{}", "°": r"$^\circ$",
        "▼": r"$\blacktriangledown$", "▲": r"$\blacktriangle$", "○": r"$\circ$",
        "α": r"$\alpha$", "β": r"$\beta$", "θ": r"$\theta$", "λ": r"$\lambda$", "σ": r"$\sigma$",
        "\u00a0": "~", "½": r"$\frac{1}{2}$",
        "[": "{[}", "]": "{]}",  # after \\ it would begin an argument
    }
)  # fmt: skip


class Section(NamedTuple):
    """A panel: its verdict, if there are several, then its tables and charts."""

    panel: Panel
    verdict: str
    parts: list[Part]


def parts_of(panel: Panel, *, pictured: bool = True) -> list[Part]:
    """Return what stands below the verdict on a panel: the list to add to."""
    tracks = track_parts(panel)
    if panel.ranked["score"].isna().all():
        return tracks
    journeys = [(tables.GROUP_WORDS[g.name][0], tables.journey_table(panel, g)) for g in GROUPS]
    below = [
        ("Calibration", tables.calibration_table(panel)),
        ("Does the quality detect large errors?", tables.detection_table(panel)),
        ("Lost, or is the map wrong here?", tables.told_apart_table(panel)),
    ]
    return [
        Part("", tables=[tables.verdict_table(panel)]),
        *tracks,
        *(Part(heading, tables=[table]) for heading, table in journeys if table),
        Part("", charts=panel_charts(panel) if pictured else []),
        *(Part(heading, tables=[table]) for heading, table in below if table),
    ]


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

    Films and figures of the folder are shown; with ``draw`` films that it lacks are drawn. Facts
    stand below, beside the command, and ``more`` is part of the first section.
    """
    panels = results.panels
    several = len(panels) > 1
    with styled(STYLE), films(panels, folder, draw=draw) as filmed:
        sections = [
            Section(
                panel,
                verdict_on(panel) if several else "",
                parts_of(panel, pictured=panel.number <= _PICTURED),
            )
            for panel in panels
        ]
        for section in sections[:1]:
            section.parts.extend(more)
        swept = swept_charts(panels)
        charts = [chart for section in sections for part in section.parts for chart in part.charts]
        drawn = {chart.name: chart.drawn("svg") for chart in (*swept, *charts)}
        animations, no_films = filmed()
    figures = pictures_of_paper(folder)
    glances = [tables.glance_table(panels)] if several else []
    if several and (validity := tables.validity_table(results)):
        glances.append(validity)
    failed, left_out = tables.failed_table(results), tables.left_out_table(results)
    methods = dict.fromkeys(name for panel in panels for name in panel.rows["method"])
    telling = {
        "results": results,
        "conclusion": conclusion(results),
        "progress": progress(results),
        "baseline": baseline_words(panels, results),
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
        "films": animations,
        "no_films": no_films,
        "pictured": _PICTURED,
        "figures": figures,
        "failed": failed,
        "left_out": left_out,
        "command": command_line(results.command),
        "environment": json.dumps(results.environment, indent=2),
        "drawn": drawn,
    }
    page = _engine().get_template("page.html.jinja").render(telling)
    markdown = _markdown(results, [Part("", "", glances, swept)], sections, animations)
    contents = {"report.html": utf8(page), "results.md": utf8(markdown)}
    contents |= {f"{IMAGES}/{name}.svg": svg for name, svg in drawn.items()}
    contents |= {f"{IMAGES}/{film.name}.webp": film.webp for film in animations}
    contents |= {f"{IMAGES}/{film.name}.png": film.png for film in animations}
    return contents


def _engine() -> Environment:
    engine = Environment(
        autoescape=lambda name: "html" in (name or ""),
        loader=PackageLoader("benchmarks", "report"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    engine.filters["base64"] = lambda content: b64encode(content).decode()
    engine.filters["table"] = lambda table: Markup(table.html)  # its cells are escaped
    engine.globals["css"] = Markup((files(__package__) / "page.css").read_text(encoding="utf-8"))
    return engine


def _markdown(
    results: Results, top: Sequence[Part], sections: Sequence[Section], films: Sequence[Animation]
) -> str:
    """Return verdict, tables and pictures, and how they were made, for a repository."""
    blocks = [f"# {plain(results.title)}", plain(conclusion(results))]
    blocks += [
        f"{progress(results)} How to read it: docs/reports.md of deqmcl-gym has every number's "
        "definition.",
        *_blocks(top),
    ]
    for section in sections:
        blocks += [f"## {section.panel.number}. {plain(section.panel.title)}"]
        blocks += [plain(section.verdict)] if section.verdict else []
        blocks += _blocks(section.parts)
    blocks += [_picture(f"{film.name}.webp", film.title, film.caption) for film in films]
    further = {
        "Failed trials": tables.failed_table(results),
        "Files left out": tables.left_out_table(results),
    }
    for heading, table in further.items():
        blocks += [f"## {heading}", _github(table)] if table else []
    environment = json.dumps(results.environment, indent=2)
    blocks += ["## How to reproduce it", fenced(command_line(results.command)), fenced(environment)]
    return "\n\n".join([*blocks, *filter(None, [results.made_by])]) + "\n"


def _blocks(parts: Sequence[Part]) -> Iterator[str]:
    for part in parts:
        yield from [f"### {part.heading}"] if part.heading else []
        yield from [plain(part.note)] if part.note else []
        for table in part.tables:
            yield from (plain(table.caption), _github(table))
        for chart in part.charts:
            yield _picture(f"{chart.name}.svg", chart.title, chart.caption)


def _picture(file: str, title: str, caption: str) -> str:
    title, caption = plain(title), plain(caption)
    return f"![{title}]({IMAGES}/{file})\n\n**{title}.** {caption}"


def _github(table: Table) -> str:
    return table.text("github", plain, "**{}**")


def plain(text: str) -> str:
    """The text on one line, with nothing in it that Markdown reads as a mark."""
    return " ".join(text.split()).translate(_MARKS)


def fenced(text: str) -> str:
    """Return text as a code block that it cannot end."""
    fence = "`" * max([3, *(1 + len(run) for run in re.findall("`+", text))])
    return f"{fence}\n{text}\n{fence}"


def latex_files(results: Results) -> dict[str, bytes]:
    """Return tables.tex and references.bib by name."""
    head = f"% Made by: {escaped(command_line(results.command))}\n"
    parts = [head + "% Needs \\usepackage{amssymb,booktabs,graphicx}.\n"]
    if len(results.panels) > 1:
        parts.append(_latex_table(tables.glance_table(results.panels), "glance", results.title))
    for panel in results.panels:
        caption = f"{panel.where}: {verdict_on(panel).partition(':')[0]}"
        parts.append(_latex_table(tables.verdict_table(panel), f"setting-{panel.number}", caption))
    cited = (files(__package__) / "references.bib").read_text(encoding="utf-8")
    return {
        "tables.tex": utf8("\n".join(parts)),
        "references.bib": utf8(cited.replace("VERSION", __version__)),
    }


def pdf_files(results: Results) -> dict[str, bytes]:
    """Return every chart of the report as figures/NAME.pdf."""
    with styled(STYLE):
        charts = swept_charts(results.panels)
        charts += [c for panel in results.panels for part in parts_of(panel) for c in part.charts]
        return {f"figures/{chart.name}.pdf": chart.drawn("pdf") for chart in charts}


def escaped(text: str) -> str:
    """Return a text as LaTeX in ASCII; a letter that it has no name for as its code, [U+4E2D]."""
    done = " ".join(text.split()).translate(_LATEX)
    return "".join(char if char.isascii() else f"{{[}}U+{ord(char):04X}{{]}}" for char in done)


def _latex_table(table: Table, label: str, caption: str) -> str:
    return (
        f"% {escaped(table.caption)}\n\\begin{{table*}}\n\\centering\\small\n"
        f"\\caption{{{escaped(caption)}.}}\n\\label{{tab:{label}}}\n"
        f"\\resizebox{{\\linewidth}}{{!}}{{{table.latex(escaped).strip()}}}\n\\end{{table*}}\n"
    )
