"""results.md: the same as the page, for a repository."""

import json
import re

from tabulate import tabulate

from benchmarks.files import command_line
from benchmarks.report import error_tables, tables, verdicts, words
from benchmarks.report.animations import lap_files
from benchmarks.report.findings import findings
from benchmarks.report.parts import Block
from benchmarks.report.story import Section, Story
from benchmarks.report.svg import Picture
from benchmarks.report.tables import Table
from benchmarks.sweeps.results import Results

_MARKS = str.maketrans({c: f"\\{c}" for c in "\\`*_[]<>|#"})

_LISTED = 100  # files left out


def markdown(story: Story, folder: str) -> str:
    """Return results.md, with its images in ``folder``."""
    results, panels = story.results, story.panels
    parts = [
        f"# {plain(results.title)}",
        f"**{plain(verdicts.conclusion(results))}**",
        plain(words.overview(results, panels)),
        f"{words.progress(results)} How to read it: "
        "docs/reports.md of deqmcl-gym has every number's definition.",
    ]
    if len(panels) > 1:
        glances = (
            error_tables.glance_table(panels),
            tables.detection_glance(panels),
            tables.validity_table(panels),
        )
        parts += ["## At a glance", *(table_text("", glance) for glance in glances if glance)]
    for section in story.sections:
        parts += _section(section, folder)
    if story.curves:
        parts += ["## Over the swept parameters", *(_image(one, folder) for one in story.curves)]
    if results.failures:
        parts += ["## Failed trials", _failures(story)]
    if results.left_out:
        parts += ["## Files left out", table_text("", left_out_table(results))]
    parts += [
        "## How to reproduce it",
        _fenced(command_line(results.command)),
        _fenced(json.dumps(results.environment, indent=2), "json"),
        *([results.made_by] if results.made_by else []),
    ]
    return "\n\n".join(parts) + "\n"


def _section(section: Section, folder: str) -> list[str]:
    panel = section.panel
    parts = [f"## {panel.number}. {plain(panel.title)}"]
    parts.append(plain(f"{verdicts.spoken(panel)} {verdicts.runner_up(panel)}"))
    parts.append(table_text("", error_tables.verdict_table(panel)))
    parts.append("\n".join(f"- {plain(one)}" for one in findings(panel)))
    parts.append(plain(verdicts.power_hint(panel)))
    for block in section.blocks:
        parts += _block(block, folder)
    for lap in section.laps:
        parts += [f"![{lap.title}]({folder}/{lap.name}.webp)", f"*{lap.title}. {lap.caption}*"]
    if section.no_laps:
        parts.append(f"No animation: {plain(section.no_laps)}")
    return [part for part in parts if part]


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
    cells = tabulate(
        [
            [
                f"**{plain(cell)}**" if (row, column) in table.strong else plain(cell)
                for column, cell in enumerate(line)
            ]
            for row, line in enumerate(table.lines)
        ],
        table.header,
        tablefmt="github",
        disable_numparse=True,
        colalign=("left", *["right"] * (len(table.header) - 1)),
    )
    said = f"**{heading}.** {plain(table.caption)}" if heading else plain(table.caption)
    return f"{said}\n\n{cells}"


def _failures(story: Story) -> str:
    return "\n".join(
        f"- {plain(describe(failure.trial))}: {plain(failure.reason)}"
        for failure in story.results.failures
    )


def images(story: Story) -> dict[str, bytes]:
    """Return the files that results.md shows, by name."""
    drawn = {f"{picture.name}.svg": picture.standalone.encode() for picture in story.pictures}
    return drawn | lap_files([lap for section in story.sections for lap in section.laps])


def left_out_table(results: Results) -> Table:
    """Which files of the folder are in no table, and why."""
    listed = list(results.left_out.items())
    lines = [[name, why] for name, why in listed[:_LISTED]]
    if len(listed) > _LISTED:
        lines.append([f"… and {len(listed) - _LISTED:,} more", ""])
    return Table("Files in the folder that are no trials of this sweep.", ["file", "why"], lines)


def describe(trial: dict[str, object]) -> str:
    """Which trial it was, in words."""
    return (
        f"{trial.get('localizer')} on {trial.get('scenario')}, world {trial.get('trial')}, "
        f"filter seed {trial.get('filter_seed')}"
    )


def _fenced(text: str, kind: str = "") -> str:
    """Return text as a code block that it cannot end."""
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}{kind}\n{text}\n{fence}"


def plain(text: str) -> str:
    """The text on one line, with nothing in it that Markdown reads as a mark."""
    return " ".join(text.split()).translate(_MARKS)
