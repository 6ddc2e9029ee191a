"""``deqmcl phase``: from laps to the figure, the data and the page."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from tabulate import tabulate

from benchmarks.files import own_folder, write_files
from benchmarks.pictures.figures import require_plots
from benchmarks.studies.phase.cycles import Cycles, PlaceFields, cycles_of, perfect_cycles
from benchmarks.tables.text import csv_text, fixed
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.files import command_line
from deqmcl_gym.validation import InputError, integer

METHODS = ("mcl", "mcl-smoother", "deq-mcl", "deq-mcl-fresh")
_PERFECT = "perfect queue"
_SHOWN = """
![A row per method: place fields over phase and step, over phase and position, and the table of the
queue](phase.png)

- **Left**: every step is a theta cycle and holds one queue, its oldest state x[t-L] at 0°, the
  present in the middle, its newest x[t+L] at 360°. The hue is the place field, its strength the
  mass of the belief in it, P(x[t+k] in the field | o[1:t]). Gray: not held.
- **Middle**: all fields laid over each other: the mean of that mass over the phase and over how far
  the robot is past the field's centre. Solid: the fitted line; dotted: that of the perfect queue.
- **Right**: a part of the table of the queue. A row is the queue at t, a column the state x[s]; the
  colour is the root mean square distance of the belief from the true place. Down a column a state
  is predicted, then filtered (on the dashed diagonal), then smoothed.

The perfect queue knows the true poses of past and future.

- **slope**: the robot's position past the field's centre is regressed on the phase, over all steps,
  offsets and fields, weighted by the mass; the slope is the inverse.
- **late by**: how far past the centre the robot is, on average, when a field is active at 180°.
- **in the right field**: mean mass in the field where the robot truly is at the state x[t+k], over
  states that are in one; past: k < 0, future: k > 0.

What it claims: a queue read from past to future makes a place fire late in the cycle first and
early last, as the hypothesis says; the numbers say how accurate that queue is. What it does not
claim: anything about neurons. That an offset is a phase is by construction, and any queue whose
future is about right precesses, whatever its source. It is one lap, so no ranking of methods.
"""


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
    from benchmarks.studies.phase.figure import phase_figure

    stages = [Stage.of(trial) for trial in trials]
    room = stages[0].room
    if not isinstance(room, RoomEnv) or room.world.route is not None:
        raise InputError(
            f"the scenario {trials[0].scenario} has no lap, along which place fields lie: choose "
            "one that has."
        )
    own_folder(out, "cycles.csv")
    path, unit = room.course.path, room.floor_plan.unit
    places = PlaceFields.along(path, fields, path.arc(room.course.start[:2]), unit)
    lag, most = trials[0].lag, 2 * len(room.course.actions)  # a driver gives up after two laps
    seen: dict[str, Cycles] = {}
    for trial, stage in zip(trials, stages, strict=True):
        lap = ((moment.truth, moment.belief) for moment in stage.moments())
        seen[trial.localizer] = cycles_of(lap, places, lag, most=most)
    truth = seen[trials[-1].localizer].truth  # the world is the same
    cycles = {_PERFECT: perfect_cycles(truth, places, lag), **seen}
    page = (
        f"# {title}\n\n```\n{command_line(command)}\n```\n\n{_table(cycles, places, 'github')}\n\n"
        f"{len(places)} place fields of radius {places.radius:.{places.decimals}f} {unit} "
        f"along the planned lap (`fields.csv`); the data is `cycles.csv`.\n{_SHOWN}"
    )
    contents = {
        "cycles.csv": _cycles_csv(cycles, unit).encode(),
        "fields.csv": _fields_csv(places).encode(),
        "phase.png": phase_figure(cycles, places, room.floor_plan, title),
        "phase.md": page.encode(),
    }
    write_files(out, contents)
    written = f"Written to {out}: {', '.join(contents)}."
    return f"{title}\n\n{_table(cycles, places, 'simple')}\n\n{written}"


def _table(cycles: Mapping[str, Cycles], fields: PlaceFields, style: str) -> str:
    """Return the numbers of each queue as a table."""
    header = ["method", "phases", f"slope °/{fields.unit}", "r", f"late by {fields.unit}"]
    header += [f"in the right field: {part}" for part in ("past", "present", "future")]
    body = []
    for name, own in cycles.items():
        row = own.precession
        phases = "n/a" if math.isnan(row.first) else f"{row.first:.0f}° to {row.last:.0f}°"
        slope = "none" if math.isnan(row.slope) else f"{row.slope:#.3g}"
        late = "n/a" if math.isnan(row.late) else f"{row.late:+.{fields.decimals}f}"
        right = map(fixed, (row.past, row.present, row.future))
        body.append([name, phases, slope, fixed(row.correlation), late, *right])
    align = ("left", "left", *["right"] * 6)
    return tabulate(body, header, tablefmt=style, disable_numparse=True, colalign=align)


def _fields_csv(fields: PlaceFields) -> str:
    """Return the place fields: number, centre, arc length on the path, radius."""
    arcs, radii = fields.arcs(fields.centres), np.full(len(fields), fields.radius)
    places = np.column_stack([fields.centres, arcs, radii]).tolist()
    rows = ([i, *(f"{value:.6g}" for value in place)] for i, place in enumerate(places, 1))
    return csv_text(["field", "x", "y", "arc", "radius"], rows)


def _cycles_csv(cycles: Mapping[str, Cycles], unit: str) -> str:
    """Return what the queues hold: a row per method, step and offset."""
    count = cycles[_PERFECT].activity.shape[2]
    header = ["method", "step", "offset", "state", "phase_deg", f"error_{unit}", f"spread_{unit}"]
    rows: list[list[object]] = []
    for name, own in cycles.items():
        phases = [f"{phase:.6g}" for phase in own.phases.tolist()]
        values = np.dstack([own.error, own.spread, own.activity])
        for t, column in np.argwhere(own.held).tolist():
            k = column - own.reach
            numbers = (f"{value:.4g}" for value in values[t, column].tolist())
            rows.append([name, t, k, t + k, phases[column], *numbers])
    return csv_text([*header, *(f"field_{i + 1}" for i in range(count))], rows)
