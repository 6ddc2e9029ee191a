"""What is drawn of the numbers that were swept: maps of regimes, or curves."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from benchmarks.report.curves import DIFFERENCE, ERROR, Quantity, swept_charts
from benchmarks.report.regimes import regime_maps
from benchmarks.report.style import Look
from benchmarks.report.svg import Picture
from benchmarks.report.verdicts import done
from benchmarks.tables.panels import Panel
from benchmarks.trials.journeys import Score


def charts_over(panels: Sequence[Panel], looks: Mapping[str, Look]) -> list[Picture]:
    """Draw what was swept: maps where three numbers were and runs are scored whole, else curves.

    They are of what all panels are about: a share of runs that succeed, or the error.
    """
    aims = {panel.aim for panel in panels}
    aim = aims.pop() if len(aims) == 1 else None
    quantities = (ERROR, DIFFERENCE) if aim is None else _shares(aim)
    curves = (swept_charts(panels, looks, quantity) for quantity in quantities)
    return regime_maps(panels) or [chart for charts in curves for chart in charts]


def _shares(aim: Score) -> tuple[Quantity, Quantity]:
    share = replace(
        ERROR,
        title=f"Runs {done(aim)}",
        axis=f"{done(aim)}, % of runs",
        caption="Bars: Wilson's 95 % intervals. A method without this parameter has the same share "
        "everywhere.",
        of=lambda row: row.standing.value.percent,
    )
    apart = replace(
        DIFFERENCE,
        axis="points above the baseline",
        caption="Above 0: more often than the baseline on the same worlds. Bars: 95 % bootstrap "
        "intervals over worlds.",
        of=lambda row: row.standing.diff.percent,
        far=math.inf,
    )
    return share, apart
