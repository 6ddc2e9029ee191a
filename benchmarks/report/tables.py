"""Tables of words: what the beliefs are worth."""

import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

from tabulate import tabulate

from benchmarks.report.words import where
from benchmarks.tables.auroc import Auroc
from benchmarks.tables.map_validity import QUESTIONS, WRONG, told_apart
from benchmarks.tables.panels import Panel
from benchmarks.tables.plan_validity import validities
from benchmarks.tables.stats import Estimate
from benchmarks.tables.text import estimated, fixed, percent, short_name, state_name
from benchmarks.trials.scores import LEVELS

_LETTERS = 140  # of a table, across a page
_NAME = 32  # letters of a method that stand on one line


class Table(NamedTuple):
    """Cells with what they are of; the first one of a line names it.

    Attributes:
        caption, header, lines: words.
        strong: cells in bold, by line and column.
        own: lines of plug-ins, which are the reader's own methods.
        words: whether its cells are words, which begin at the left.
    """

    caption: str
    header: list[str]
    lines: list[list[str]]
    strong: Collection[tuple[int, int]] = ()
    own: Collection[int] = ()
    words: bool = False

    @property
    def looks(self) -> str:
        """How a page shows it: wide if its cells do not fit side by side on one line each."""
        most = [max(map(len, column)) for column in zip(*self.lines, strict=True)]
        shown = {
            "words": self.words,
            "wide": not self.words and sum(most) + 3 * len(most) > _LETTERS,
            "named": self.header[0] == "method" and most and most[0] <= _NAME,
        }
        return " ".join(name for name, so in shown.items() if so)

    def text(self, style: str, words: Callable[[str], str] = str, strong: str = "{}") -> str:
        """Return it without its caption in a format of tabulate; cells: see ``marked_up``."""
        return tabulate(
            self.marked_up(words, strong),
            self.header,
            tablefmt=style,
            disable_numparse=True,
            colalign=("left", *["left" if self.words else "right"] * (len(self.header) - 1)),
        )

    def marked_up(self, words: Callable[[str], str], strong: str) -> list[list[str]]:
        """Return the lines in a markup language.

        Args:
            words: gives a cell's words in it.
            strong: a pattern of bold words, as "**{}**".
        """
        return [
            [
                strong.format(words(cell)) if (row, column) in self.strong else words(cell)
                for column, cell in enumerate(line)
            ]
            for row, line in enumerate(self.lines)
        ]


def calibration_table(panel: Panel) -> Table:
    """Calibration of the beliefs at every offset."""
    header = ["method", "belief about", f"energy score, {panel.unit}"]
    header += ["inside 50 %", "80 %", "95 %", "NEES (3)", "entropy, nats", "in walls"]
    lines = []
    for row in panel.rows:
        scores = row.scores
        lines.append(
            [
                panel.labels[row.method],
                state_name(row.offset),
                fixed(scores["energy_score"].mean),
                *(estimated(scores[f"coverage_{at}"].percent, ".0f", " %") for at in LEVELS),
                nees_words(scores["nees"]),
                fixed(scores["entropy"].mean).replace("-", "−"),
                percent(scores["wall_share"].mean, 1),
            ]
        )
    caption = (
        "Calibration, with 95 % intervals over worlds; n/a: the method's belief has no spread."
    )
    return Table(caption, header, lines)


def nees_words(found: Estimate) -> str:
    """A NEES with one decimal; a large one, which is far from 3 anyhow, with three digits."""
    if not found.mean >= 100:
        return estimated(found, ".1f")
    return estimated(Estimate(*(float(f"{value:.3g}") for value in found)), ",.0f")


def detection_table(panel: Panel) -> Table | None:
    """The AUROC of each method; None if no method gives a quality and was far off, not always."""
    if all(math.isnan(row.detection.auroc.mean) for row in panel.present):
        return None
    far = panel.far
    lines = []
    for row in panel.present:
        found = row.detection
        worlds = "n/a" if found.far_worlds is None else f"{found.far_worlds} of {row.worlds}"
        share = percent(found.far_steps, 1)
        lines.append([panel.labels[row.method], _auroc(found), share, worlds])
    caption = (
        f"AUROC of the quality at x[t] against {far}, over all steps of all worlds; 1: every far "
        "step has a smaller quality than every other, ½: no better than chance."
    )
    header = ["method", "AUROC, 95 % interval", f"steps with {far}", "in how many worlds"]
    return Table(caption, header, lines)


def detection_glance(panels: Sequence[Panel]) -> Table | None:
    """The AUROC of the methods that give a quality, on all settings; None if there is none."""
    if not any(map(detection_table, panels)):
        return None
    found = [{panel.labels[row.method]: row.detection for row in panel.present} for panel in panels]
    labels = [
        label
        for label in all_labels(panels)
        if any(own[label].far_worlds is not None for own in found if label in own)
    ]
    lines = [
        [
            numbered(panel),
            *(fixed(own[label].auroc.mean) if label in own else "–" for label in labels),
        ]
        for panel, own in zip(panels, found, strict=True)
    ]
    far = ", ".join(dict.fromkeys(panel.far for panel in panels))
    caption = (
        f"AUROC of the quality at x[t] against {far}: 1 separates all far steps from the others, "
        "½ is chance; n/a where no step, or every one, is far off."
    )
    return Table(caption, ["setting", *labels], lines)


def validity_table(panels: Sequence[Panel]) -> Table | None:
    """The AUROC of what filters make of plans; None if none reads plans, or none conflicts."""
    rows = [row for row in validities(panels) if any(map(_tells, row.signals.values()))]
    if not rows:
        return None
    names = list(dict.fromkeys(name for row in rows for name in row.signals))
    lines = []
    for row in rows:
        first, *_ = row.panels
        told = {name: own for name, own in row.signals.items() if _tells(own)}
        scenarios = ", ".join(short_name(panel.setting.scenario) for panel in row.panels)
        lines.append(
            [
                ", ".join([scenarios, *first.title.split(", ")[1:]]),
                row.label,
                *(_auroc(told[name]) if name in told else "–" for name in names),
                percent(next(iter(told.values())).far_steps, 1),
            ]
        )
    caption = (
        "AUROC of what a filter makes of a plan against whether the plan, laid from the true pose, "
        "collides. feasible: share of the belief from which it does not; tempering: λ; "
        "log_evidence: of the belief with the plan over that without; log_evidence_20: its mean "
        "over 20 steps; trusted: P(the plans are about this robot); trusted_lap: its least in a "
        "lap, against whether the plan collides at any of its steps; quality: confidence by the "
        "scans. 1: a plan in conflict always has the smaller value; ½: chance. The scenarios of a "
        "line are taken together."
    )
    header = ["scenarios", "method", *names, "steps in conflict"]
    return Table(caption, header, lines)


def told_apart_table(panel: Panel) -> Table | None:
    """The AUROC of what may tell lost robots from wrong maps; None where none is wrong."""
    rows = []
    for row in told_apart([panel]):
        for question, signals in row.answers.items():
            if told := {name: own for name, own in signals.items() if _tells(own)}:
                rows.append((panel.labels[row.method], QUESTIONS[question], told))
    if not rows:
        return None
    names = list(dict.fromkeys(name for *_, told in rows for name in told))
    lines = []
    for label, question, told in rows:
        cells = [estimated(told[name].auroc) if name in told else "–" for name in names]
        share = percent(next(iter(told.values())).far_steps, 1)
        lines.append([label, question, *cells, share])
    caption = (
        "AUROC of what is seen at the best cluster. lost: it is not within 1 m and 30° of the true "
        f"pose; the map is wrong here: more than {percent(WRONG)} of the returns contradict it "
        "at the true pose. quality: confidence; explained: share of the returns that "
        "agree with the map; beyond_random: explained, less the most at one of 256 random poses; "
        "short, long: shares that contradict it; repeated, elsewhere: shares that do so where the "
        "map was contradicted from another pose before, and where it was not; trusted: the belief "
        "that the plan is about this robot. 1: trouble always has the smaller quality, explained, "
        "beyond_random or trust, or the larger share; ½: chance; below ½: the opposite."
    )
    return Table(caption, ["method", "question", *names, "steps that are"], lines)


def _tells(found: Auroc) -> bool:
    return not math.isnan(found.auroc.mean)


def _auroc(found: Auroc) -> str:
    """The AUROC with its interval, or why there is none."""
    if found.far_worlds is None:
        return "n/a: gives no quality"
    if found.far_worlds == 0:
        return "n/a: no step is far off"
    if found.far_steps == 1:
        return "n/a: every step is far off"
    alone = " (in one world only: no interval)" if math.isnan(found.auroc.low) else ""
    return estimated(found.auroc) + alone


def all_labels(panels: Sequence[Panel]) -> list[str]:
    """What the methods of all panels are called."""
    return list(dict.fromkeys(label for panel in panels for label in panel.labels.values()))


def numbered(panel: Panel) -> str:
    """The title of a panel in a column of settings, behind its number."""
    return f"{panel.number}. {where(panel)}"
