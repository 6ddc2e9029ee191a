"""results.md: the same as the page, for a repository."""

import json
import re

from tabulate import tabulate

from benchmarks.files import command_line
from benchmarks.report import error_tables, tables, verdicts, words
from benchmarks.report.animations import lap_files
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
        f"# {_plain(results.title)}",
        f"**{_plain(verdicts.conclusion(results))}**",
        _plain(words.overview(results, panels)),
        f"{words.progress(results)} How to read it: "
        "docs/reports.md of deqmcl-gym has every number's definition.",
    ]
    if len(panels) > 1:
        glances = (
            error_tables.glance_table(panels),
            tables.detection_glance(panels),
            tables.validity_table(panels),
        )
        parts += ["## At a glance", *(_table("", glance) for glance in glances if glance)]
    for section in story.sections:
        parts += _section(section, folder)
    if story.curves:
        parts += ["## Over the swept parameters", *(_image(one, folder) for one in story.curves)]
    if results.failures:
        parts += ["## Failed trials", _failures(story)]
    if results.left_out:
        parts += ["## Files left out", _table("", left_out_table(results))]
    parts += [
        "## How to reproduce it",
        _fenced(command_line(results.command)),
        _fenced(json.dumps(results.environment, indent=2), "json"),
    ]
    return "\n\n".join(parts) + "\n"


def _section(section: Section, folder: str) -> list[str]:
    panel = section.panel
    parts = [f"## {panel.number}. {_plain(panel.title)}"]
    parts.append(_plain(f"{verdicts.spoken(panel)} {verdicts.runner_up(panel)}"))
    parts.append(_table("", error_tables.verdict_table(panel)))
    parts.append("\n".join(f"- {_plain(one)}" for one in verdicts.findings(panel)))
    parts.append(_plain(verdicts.power_hint(panel)))
    for block in section.blocks:
        parts += _block(block, folder)
    for lap in section.laps:
        parts += [f"![{lap.title}]({folder}/{lap.name}.webp)", f"*{lap.title}. {lap.caption}*"]
    if section.no_laps:
        parts.append(f"No animation: {_plain(section.no_laps)}")
    return [part for part in parts if part]


def _block(block: Block, folder: str) -> list[str]:
    parts = [f"**{_plain(block.heading)}.** {_plain(block.note)}"] if block.note else []
    parts += [_table(block.heading, table) for table in block.tables]
    if block.small:
        shown = "\n".join(f"![{_plain(p.alt)}]({folder}/{p.name}.svg)" for p in block.pictures)
        return [*parts, shown]
    return [*parts, *(_image(one, folder) for one in block.pictures)]


def _image(picture: Picture, folder: str) -> str:
    heading = f"**{_plain(picture.title)}.** {_plain(picture.caption)}"
    return f"![{_plain(picture.alt)}]({folder}/{picture.name}.svg)\n\n{heading}"


def _table(heading: str, table: Table) -> str:
    cells = tabulate(
        [
            [
                f"**{_plain(cell)}**" if (row, column) in table.strong else _plain(cell)
                for column, cell in enumerate(line)
            ]
            for row, line in enumerate(table.lines)
        ],
        table.header,
        tablefmt="github",
        disable_numparse=True,
        colalign=("left", *["right"] * (len(table.header) - 1)),
    )
    said = f"**{heading}.** {_plain(table.caption)}" if heading else _plain(table.caption)
    return f"{said}\n\n{cells}"


def _failures(story: Story) -> str:
    return "\n".join(
        f"- {_plain(describe(failure.trial))}: {_plain(failure.reason)}"
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


def _plain(text: str) -> str:
    return " ".join(text.split()).translate(_MARKS)
