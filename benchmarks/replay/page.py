"""report.html of a replay."""

import json
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

from benchmarks.replay.charts import error_charts, localized_chart, trajectory_charts
from benchmarks.replay.scoring import Row
from benchmarks.replay.setting import Setting
from benchmarks.replay.tables import evo_table
from benchmarks.replay.verdict import comparison, tables_of, verdict
from benchmarks.replay.words import facts, overview
from benchmarks.report.pages import page
from benchmarks.report.svg import HOUSE_STYLE, looks
from benchmarks.trials.provenance import environment
from deqmcl_gym.files import command_line


def report(
    setting: Setting,
    rows: Sequence[Row],
    warnings: Sequence[str],
    failed: Sequence[str],
    command: Sequence[str],
) -> str:
    """Return report.html."""
    there = [row for row in rows if row.played]
    referenced = bool(setting.log.referenced.size)
    look = looks(row.localizer for row in there)
    floor_plan = setting.env().floor_plan
    with mpl.rc_context(HOUSE_STYLE):
        trajectories = [
            chart
            for number, row in enumerate(there, 1)
            for chart in trajectory_charts(row, floor_plan, look[row.localizer], number)
        ]
        errors = error_charts(there, look) if referenced and there else []
        localized = localized_chart(there, look) if errors else None
    return page(
        "replay/page.html.jinja",
        title=f"Replay of {Path(setting.log.source).name}",
        overview=overview(setting),
        facts=facts(setting),
        warnings=warnings,
        verdict=verdict(rows),
        comparison=comparison(rows),
        tables=tables_of(rows, referenced),
        trajectories=trajectories,
        errors=errors,
        localized=localized,
        evo=evo_table(there) if errors else None,
        failed=failed,
        command=command_line(command),
        environment=json.dumps(environment(), indent=2),
    )
