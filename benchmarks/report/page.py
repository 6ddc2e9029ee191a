"""Reports: tables as CSV, report.html without network and scripts, and what a paper needs of them.

A paper needs tables in LaTeX (booktabs), charts in PDF, and BibTeX of what is cited.
"""

import json
from base64 import b64encode
from collections.abc import Sequence
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.console import doing
from benchmarks.report import tables
from benchmarks.report.charts import panel_charts, styled, swept_charts
from benchmarks.report.films import IMAGES, animations, pictures_of_paper
from benchmarks.report.runs import starts_table
from benchmarks.report.tables import Part
from benchmarks.report.tracks import track_parts
from benchmarks.report.verdict import conclusion, progress, verdict_on
from benchmarks.sweeps.manifest import MANIFEST
from benchmarks.sweeps.results import Results
from benchmarks.sweeps.store import own_folder, write_files
from benchmarks.tables import percent, short_name, short_names
from benchmarks.tables.comparison import FURTHER
from benchmarks.tables.frames import INNER, csv_of, timings_table, trials_frame
from benchmarks.tables.panels import Panel
from benchmarks.trials.scores import GROUPS
from benchmarks.trials.tracks import TOLERATED
from deqmcl_gym import __version__
from deqmcl_gym.files import command_line, utf8
from deqmcl_gym.validation import InputError, shown

_PICTURED = 8  # panels with pictures; the tables are of all
_HEADINGS = {  # of groups of scores of whole runs
    "lost": "Localized",
    "ambiguity": "Two places that fit",
    "recovery": "Found again",
    "log": "Against the reference",
    "driving": "Arrived",
}
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


def no_report() -> str | None:
    """Say why a report cannot be made here, naming the pip command; None if it can."""
    missing = " and ".join(name for name in ("jinja2", "matplotlib") if find_spec(name) is None)
    why = f"a report needs {missing}, which is not installed: pip install 'deqmcl-gym[report]'."
    return why if missing else None


def require_report() -> None:
    """Refuse to go on without what a report is made with."""
    if (why := no_report()) is not None:
        raise InputError(why)


def write_report(
    out: Path | str, results: Results, *, draw: bool = True, of: Path | None = None
) -> list[Path]:
    """Write the tables, report.html and images/ of a sweep; return the files.

    Films that the folder lacks are drawn, unless ``draw`` is false; those and the figures ``of``
    another folder are shown if it is given. results.csv and trials.csv depend on nothing but the
    trials; timings.csv and the page also tell times and versions. Without the extra
    ``report`` there are the tables only. A folder that holds files, but neither a sweep nor a
    report, raises ``InputError``.
    """
    if not isinstance(results, Results):
        raise InputError(f"the results are {shown(results)}: give the folder first, then results.")
    folder = Path(out)
    with doing(f"writing the report in {folder}"):
        if of is not None or not (folder / MANIFEST).is_file():
            own_folder(folder, "results.csv")
        tables = _tables(results)
        for name in ("decisions.csv", "plans.csv", "basin.csv"):
            if name not in tables:
                (folder / name).unlink(missing_ok=True)
        files = write_files(folder, tables)  # the numbers, whatever keeps the pictures away
        if no_report() is not None:
            return files
        pages = page_files(results, of or folder, draw=draw)
        for path in (folder / "images").glob("lap-*"):  # of worlds that are not shown any more
            if f"images/{path.name}" not in pages:
                path.unlink()
        return files + write_files(folder, pages)


def _tables(results: Results) -> dict[str, bytes]:
    tables = {
        "results": csv_of(results.table, FURTHER),
        "trials": csv_of(trials_frame(results.records), INNER),
        "timings": csv_of(timings_table(results.records)),
    }
    if results.rule is not None:
        tables["decisions"] = csv_of(results.decisions)
    starts = starts_table(results.records, (failure.trial for failure in results.failures))
    further = {"plans": results.plans, "basin": starts}
    tables |= {name: csv_of(table) for name, table in further.items() if len(table)}
    return {f"{name}.csv": utf8(text) for name, text in tables.items()}


def parts_of(panel: Panel, *, pictured: bool = True) -> list[Part]:
    """Return what stands below the verdict on a panel: the list to add to."""
    tracks = track_parts(panel)
    if panel.ranked["score"].isna().all():
        return tracks
    journeys = [(_HEADINGS[group.name], tables.journey_table(panel, group)) for group in GROUPS]
    below = [
        ("Calibration, as believed" if tracks else "Calibration", tables.calibration_table(panel)),
        ("Does the quality detect large errors?", tables.detection_table(panel)),
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
    """Return report.html and its pictures by name.

    Films and figures of the folder are shown; with ``draw`` films that it lacks are drawn. Facts
    stand below, beside the command, and ``more`` is part of the first section.
    """
    panels = results.panels
    films, no_films = animations(panels, folder, draw)
    with styled():
        parts = [parts_of(panel, pictured=panel.number <= _PICTURED) for panel in panels]
        for first in parts[:1]:
            first.extend(more)
        swept = swept_charts(panels)
        charts = [chart for content in parts for part in content for chart in part.charts]
        drawn = {chart.name: chart.drawn("svg") for chart in (*swept, *charts)}
    context = {
        "results": results,
        "conclusion": conclusion(results),
        "progress": progress(results),
        "world": next((panel.world for panel in panels), "world"),
        "most": percent(1 - TOLERATED),
        "notes": notes,
        "warnings": warnings,
        "facts": facts,
        "glance": tables.glance_table(panels) if len(panels) > 1 else None,
        "swept": swept,
        "sections": list(zip(panels, map(verdict_on, panels), parts, strict=True)),
        "films": films,
        "no_films": no_films,
        "pictured": _PICTURED,
        "figures": pictures_of_paper(folder),
        "failed": tables.failed_table(results),
        "command": command_line(results.command),
        "environment": json.dumps(results.environment, indent=2),
        "drawn": drawn,
    }
    page = _engine().get_template("report.html.jinja").render(context)
    contents = {"report.html": utf8(page)}
    contents |= {f"{IMAGES}/{name}.svg": svg for name, svg in drawn.items()}
    contents |= {f"{IMAGES}/{film.name}.webp": film.webp for film in films}
    contents |= {f"{IMAGES}/{film.name}.png": film.png for film in films}
    return contents


def _engine() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # an optional extra
    from markupsafe import Markup

    engine = Environment(
        autoescape=lambda name: "html" in (name or ""),
        loader=PackageLoader("benchmarks", "report"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    engine.filters |= {
        "short": short_name,
        "shorts": short_names,
        "base64": lambda content: b64encode(content).decode(),
        "table": lambda table: Markup(table.html),  # its cells are escaped
        "tex": escaped,
        "tabular": lambda table: table.latex(escaped).strip(),
    }
    engine.globals["css"] = Markup((files(__package__) / "page.css").read_text(encoding="utf-8"))
    return engine


def latex_files(results: Results) -> dict[str, bytes]:
    """Return tables.tex and references.bib by name."""
    shown = [(tables.glance_table(results.panels), "glance", results.title)]
    shown = shown if len(results.panels) > 1 else []
    for panel in results.panels:
        caption = f"{panel.where}: {verdict_on(panel).partition(':')[0]}"
        shown.append((tables.verdict_table(panel), f"setting-{panel.number}", caption))
    template = _engine().get_template("tables.tex.jinja")
    world = next((panel.world for panel in results.panels), "world")
    tex = template.render(command=command_line(results.command), tables=shown, world=world)
    cited = (files(__package__) / "references.bib").read_text(encoding="utf-8")
    return {"tables.tex": utf8(tex), "references.bib": utf8(cited.replace("VERSION", __version__))}


def pdf_files(results: Results) -> dict[str, bytes]:
    """Return every chart of the report as figures/NAME.pdf."""
    with styled():
        charts = swept_charts(results.panels)
        charts += [c for panel in results.panels for part in parts_of(panel) for c in part.charts]
        return {f"figures/{chart.name}.pdf": chart.drawn("pdf") for chart in charts}


def escaped(text: str) -> str:
    """Return a text as LaTeX in ASCII; a letter that it has no name for as its code, [U+4E2D]."""
    done = " ".join(text.split()).translate(_LATEX)
    return "".join(char if char.isascii() else f"{{[}}U+{ord(char):04X}{{]}}" for char in done)
