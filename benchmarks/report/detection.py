"""Does the quality tell when a belief is far off: the tables of AUROC."""

import math
from collections.abc import Sequence

from benchmarks.report.panels import Panel
from benchmarks.report.words import interval, percent
from benchmarks.tables.auroc import Auroc
from benchmarks.tables.text import fixed

HEADING = "Does its quality tell when it is far off?"
CAPTION = (
    "AUROC of the quality at x[t] against e > 50 px, over all steps of all worlds; 1: every far "
    "step has a smaller quality than every other, ½: no better than chance"
)
GLANCE = (
    "AUROC of the quality at x[t] against e > 50 px: 1 tells every far step, ½ is chance; n/a "
    "where no step, or every one, is far off."
)


def informative(panels: Sequence[Panel]) -> bool:
    """Whether some method gives a quality and was far off at some of its steps, not at all."""
    return any(not math.isnan(row.detection.auroc) for panel in panels for row in panel.present)


def detection_table(panel: Panel) -> tuple[list[str], list[list[str]]]:
    """Header and lines of the AUROC of each method on one setting."""
    header = ["method", "AUROC, 95 % interval", "steps with e > 50 px", "in how many worlds"]
    lines = []
    for row in panel.present:
        found = row.detection
        worlds = "n/a" if found.far_worlds is None else f"{found.far_worlds} of {row.worlds}"
        share = percent(found.far_steps, 1)
        lines.append([panel.labels[row.method], auroc_in_words(found), share, worlds])
    return header, lines


def detection_glance(panels: Sequence[Panel]) -> tuple[list[str], list[list[str]]]:
    """Header and lines of the AUROC of the methods that give a quality, on all settings."""
    found = [{panel.labels[row.method]: row.detection for row in panel.present} for panel in panels]
    labels = [
        label
        for label in dict.fromkeys(label for by_label in found for label in by_label)
        if any(own[label].far_worlds is not None for own in found if label in own)
    ]
    lines = [
        [
            f"{panel.number}. {panel.title}",
            *(fixed(by_label[label].auroc) if label in by_label else "–" for label in labels),
        ]
        for panel, by_label in zip(panels, found, strict=True)
    ]
    return ["setting", *labels], lines


def auroc_in_words(found: Auroc) -> str:
    """The AUROC with its interval, or why there is none."""
    if found.far_worlds is None:
        return "n/a: gives no quality"
    if found.far_worlds == 0:
        return "n/a: no step is far off"
    if found.far_steps == 1:
        return "n/a: every step is far off"
    bounds = interval(found.auroc_low, found.auroc_high)
    return f"{fixed(found.auroc)} ({bounds or 'in one world only: no interval'})"
