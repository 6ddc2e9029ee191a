"""report.html: one page without network and scripts, escaped by jinja2."""

import json
import re
from base64 import b64encode
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchmarks.files import command_line
from benchmarks.report import error_tables, tables, verdicts, words
from benchmarks.report.findings import findings
from benchmarks.report.markdown import describe, left_out_table
from benchmarks.report.story import PICTURED, Story
from benchmarks.report.style import LOOKS
from benchmarks.tables.table_1 import full_name


def html(story: Story) -> str:
    """Return report.html."""
    results = story.results
    return page(
        "report/page.html.jinja",
        title=results.title,
        results=results,
        sections=story.sections,
        panels=story.panels,
        curves=story.curves,
        notes=story.notes,
        warnings=story.warnings,
        tables=tables,
        error_tables=error_tables,
        verdicts=verdicts,
        findings=findings,
        baseline=full_name(results.baseline),
        conclusion=verdicts.conclusion(results),
        overview=words.overview(results, story.panels),
        progress=words.progress(results),
        failed=tables.Table(
            "Trials that raised an error; no mean includes them.",
            ["trial", "reason"],
            [[describe(failure.trial), failure.reason] for failure in results.failures],
        ),
        left_out=left_out_table(results),
        command=command_line(results.command),
        environment=json.dumps(results.environment, indent=2),
        pictured=PICTURED,
    )


def page(template: str, **values: Any) -> str:
    """Return a page of the house's style.

    Args:
        template: a file of the package ``benchmarks`` that extends report/frame.html.jinja.
        values: what it shows; ``title`` for one.
    """
    engine = Environment(
        autoescape=True,
        loader=PackageLoader("benchmarks", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    engine.filters["inline"] = lambda picture: Markup(picture.inline)  # matplotlib has escaped it
    engine.filters["base64"] = lambda content: b64encode(content).decode()
    engine.filters["whole"] = whole
    engine.filters["capital"] = words.capital
    css = (files("benchmarks.report") / "page.css").read_text(encoding="utf-8")
    return engine.get_template(template).render(style=Markup(_variables() + css), **values)


def whole(cell: str) -> str:
    """Return a table's cell so that lines break nowhere but before an interval or an SD."""
    inside = re.sub(r"\([^()]*\)", lambda part: part[0].replace(" ", "\u00a0"), cell)
    return re.sub(r"(?<=\d) (?=[%×▲▼○])", "\u00a0", inside)


def _variables() -> str:
    light = "".join(f"--{look.name}: {look.color}; " for look in LOOKS)
    dark = "".join(f"--{look.name}: {look.dark}; " for look in LOOKS)
    of_dark = f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}"
    return f":root {{ {light}}}\n{of_dark}\n"
