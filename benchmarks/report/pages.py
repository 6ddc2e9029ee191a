"""report.html, one page without network and scripts, and results.md, the same for a repository."""

import json
import re
from base64 import b64encode
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from benchmarks.report.animations import animation_files
from benchmarks.report.story import PICTURED, Block, Section, Story
from benchmarks.report.svg import LOOKS, Picture
from benchmarks.report.tables import Table
from benchmarks.report.words import Said, baseline_name
from benchmarks.tables.text import capital
from deqmcl_gym.files import command_line


def html(story: Story) -> str:
    """Return report.html."""
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
    engine.filters["cell"] = cell
    engine.filters["capital"] = capital
    light = "".join(f"--{look.name}: {look.color}; " for look in LOOKS)
    dark = "".join(f"--{look.name}: {look.dark}; " for look in LOOKS)
    of_dark = f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}"
    css = (files("benchmarks.report") / "page.css").read_text(encoding="utf-8")
    results = story.results
    return engine.get_template("report/page.html.jinja").render(
        style=Markup(f":root {{ {light}}}\n{of_dark}\n{css}"),
        title=results.title,
        story=story,
        sections=story.sections,
        baseline=baseline_name(results),
        partial=bool(results.missing or results.failures),
        command=command_line(results.command),
        environment=json.dumps(results.environment, indent=2),
        pictured=PICTURED,
    )


def whole(text: str) -> str:
    """Return a text so that lines break neither within an interval or SD nor before a unit."""
    inside = re.sub(
        r"\((?=[^()]*\d)[^()]{,28}\)", lambda part: part[0].replace(" ", "\u00a0"), text
    )
    return re.sub(r"(?<=\d) (?=[%×▲▼○]|px\b|m\b|points\b|to [−\d]|of \d)", "\u00a0", inside)


def parted(cell: str) -> tuple[str, str]:
    """Return a number and the interval or SD behind it; "" if there is none."""
    value, found, ends = whole(cell).partition(" (")
    apart = found and value[:1] in "+−0123456789" and ends.endswith(")")
    return (value, f"({ends}") if apart else (whole(cell), "")


def cell(text: str) -> Markup:
    """Return a table's cell: an interval or SD is on a line of its own in all rows, or in none."""
    value, ends = parted(text)
    return Markup("{} <span>{}</span>").format(value, ends) if ends else escape(value)


_MARKS = str.maketrans({c: f"\\{c}" for c in "\\`*_[]<>|#"})


def markdown(story: Story, folder: str) -> str:
    """Return results.md, with its images in ``folder``."""
    results = story.results
    parts = [
        f"# {plain(results.title)}",
        _bold(story.conclusion),
        plain(story.overview),
        f"{story.progress} How to read it: "
        "docs/reports.md of deqmcl-gym has every number's definition.",
    ]
    if story.glances:
        shown = [*story.glances, *([story.validity] if story.validity else [])]
        parts += ["## At a glance", *(table_text("", glance) for glance in shown)]
    for section in story.sections:
        parts += _section(section, folder, known=bool(story.figures))
    if story.figures:
        parts += ["## The paper's figures, of world 0"]
        parts += [
            f"![{f.title}]({folder}/{f.name})\n\n**{f.title}.** {f.caption}" for f in story.figures
        ]
    if story.curves:
        parts += ["## Over the swept parameters", *(_image(one, folder) for one in story.curves)]
    if story.failed.lines:
        failed = (f"- {plain(trial)}: {plain(reason)}" for trial, reason in story.failed.lines)
        parts += ["## Failed trials", "\n".join(failed)]
    if story.left_out.lines:
        parts += ["## Files left out", table_text("", story.left_out)]
    parts += [
        "## How to reproduce it",
        fenced(command_line(results.command)),
        fenced(json.dumps(results.environment, indent=2), "json"),
        *([results.made_by] if results.made_by else []),
    ]
    return "\n\n".join(parts) + "\n"


def _section(section: Section, folder: str, *, known: bool) -> list[str]:
    panel = section.panel
    parts = [f"## {panel.number}. {plain(panel.title)}"]
    parts.append(f"{_bold(section.verdict)} {plain(section.runner_up)}".strip())
    if panel.verdict is not None:
        parts.append(table_text("", section.table))
        parts.append("\n".join(f"- {plain(one)}" for one in section.findings))
        parts.append(plain(section.power))
    for block in section.blocks:
        parts += _block(block, folder)
    for one in section.animations:
        parts += [f"![{one.title}]({folder}/{one.name}.webp)", f"*{one.title}. {one.caption}*"]
    if section.no_animation and not known:
        parts.append(f"No animation: {plain(section.no_animation)}")
    return [part for part in parts if part]


def _bold(said: Said) -> str:
    """A verdict, its first words in bold."""
    more = said.text.removeprefix(said.short)
    return f"**{plain(said.short)}**{plain(more)}"


def _block(block: Block, folder: str) -> list[str]:
    parts = [f"**{plain(block.heading)}.** {plain(block.note)}"] if block.note else []
    parts += [table_text(block.heading, table) for table in block.tables]
    if block.small:
        shown = "\n".join(f"![{plain(p.alt)}]({folder}/{p.name}.svg)" for p in block.pictures)
        return [*parts, shown]
    return [*parts, *(_image(one, folder) for one in block.pictures)]


def _image(picture: Picture, folder: str) -> str:
    heading = f"**{plain(picture.title)}.** {plain(picture.caption)}"
    return f"![{plain(picture.alt)}]({folder}/{picture.name}.svg)\n\n{heading}"


def table_text(heading: str, table: Table) -> str:
    """The table, below its heading and caption."""
    said = f"**{heading}.** {plain(table.caption)}" if heading else plain(table.caption)
    return f"{said}\n\n{table.text('github', plain, '**{}**')}"


def images(story: Story) -> dict[str, bytes]:
    """Return the files that results.md shows, by name."""
    drawn = {f"{picture.name}.svg": picture.standalone.encode() for picture in story.pictures}
    animations = [one for section in story.sections for one in section.animations]
    return drawn | animation_files(animations) | {one.name: one.content for one in story.figures}


def fenced(text: str, kind: str = "") -> str:
    """Return text as a code block that it cannot end."""
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}{kind}\n{text}\n{fence}"


def plain(text: str) -> str:
    """The text on one line, with nothing in it that Markdown reads as a mark."""
    return " ".join(text.split()).translate(_MARKS)
