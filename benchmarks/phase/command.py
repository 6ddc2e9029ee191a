"""From laps to the figure, the data and the page."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.files import writable_folder, write_bytes
from benchmarks.phase.cycles import Cycles, cycles_of, perfect_cycles
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.figure import Panel, phase_figure
from benchmarks.phase.page import PERFECT, cycles_csv, fields_csv, page, table, told
from benchmarks.phase.precession import precession
from benchmarks.pictures.plots import require_plots
from benchmarks.tables.table_1 import TITLES
from benchmarks.trials.episode import room_of, trial_moments
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import integer

METHODS = ("mcl", "mcl-smoother", "deq-mcl", "deq-mcl-rejuvenated")


def run_phase(
    trials: Sequence[Trial], fields: int, out: Path, title: str, command: Sequence[str]
) -> str:
    """Run a lap of each localizer on one world; write figure, data and page; return what to print.

    Args:
        trials: one per localizer.
        fields: number of place fields.
        out: folder.
        title: of the figure and the page.
        command: the words that this was started by.
    """
    integer("--fields", fields, low=2, high=100)
    require_plots()
    writable_folder(out)
    room = room_of(trials[0].scenario)
    path = room.course.path
    places = PlaceFields.along(path, fields, start=path.arc(room.course.start[:2]))
    perfect, laps = _laps(trials, places)
    panels = [_panel(name, cycles) for name, cycles in laps.items()]
    first = _panel(PERFECT, perfect)
    picture = phase_figure(first, panels, places, room.floor_plan, title)
    rows = {panel.title: panel.precession for panel in (first, *panels)}
    contents = {
        "cycles.csv": cycles_csv({PERFECT: perfect} | laps).encode(),
        "fields.csv": fields_csv(places).encode(),
        "phase.png": picture,
        "phase.md": page(title, rows, places, command).encode(),
    }
    for name, content in contents.items():
        write_bytes(out / name, content)
    return f"{title}\n\n{table(rows, 'simple')}\n\nWritten to {out}: {', '.join(contents)}."


def _laps(trials: Sequence[Trial], fields: PlaceFields) -> tuple[Cycles, dict[str, Cycles]]:
    """Return the lap of a perfect queue and that of each localizer; the world is the same."""
    laps: dict[str, Cycles] = {}
    for trial in trials:
        episode = list(trial_moments(trial))
        laps[trial.localizer] = cycles_of(episode, fields, trial.lag)
    truth = np.array([moment.truth for moment in episode])
    return perfect_cycles(truth, fields, trials[0].lag), laps


def _panel(name: str, cycles: Cycles) -> Panel:
    found = precession(cycles)
    title = TITLES.get(name, name)
    return Panel(
        title=title[:1].upper() + title[1:],
        words=told(found),
        cycles=cycles,
        precession=found,
    )
