"""phase.md and the CSV files behind the figure."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from tabulate import tabulate

from benchmarks.files import command_line
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.precession import Lap
from benchmarks.tables.text import csv_text

_NONE = "n/a"

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


def table(laps: Sequence[Lap], fields: PlaceFields, style: str) -> str:
    """Return the numbers of each lap as a table."""
    header = ["method", "phases", f"slope °/{fields.unit}", "r", f"late by {fields.unit}"]
    header += [f"in the right field: {part}" for part in ("past", "present", "future")]
    body = []
    for lap in laps:
        row = lap.precession
        phases = _NONE if math.isnan(row.first) else f"{row.first:.0f}° to {row.last:.0f}°"
        slope = "none" if math.isnan(row.slope) else f"{row.slope:#.3g}"
        numbers = [_number(row.correlation), _number(row.late, f"+.{fields.decimals}f")]
        numbers += map(_number, (row.past, row.present, row.future))
        body.append([lap.title, phases, slope, *numbers])
    align = ("left", "left", *["right"] * 6)
    return tabulate(body, header, tablefmt=style, disable_numparse=True, colalign=align)


def page(title: str, laps: Sequence[Lap], fields: PlaceFields, command: Sequence[str]) -> str:
    """Return phase.md: the numbers, what is to be seen, what is claimed and what not."""
    return (
        f"# {title}\n\n```\n{command_line(command)}\n```\n\n{table(laps, fields, 'github')}\n\n"
        f"{len(fields)} place fields of radius {fields.radius:.{fields.decimals}f} {fields.unit} "
        f"along the planned lap (`fields.csv`); the data is `cycles.csv`.\n{_SHOWN}"
    )


def fields_csv(fields: PlaceFields) -> str:
    """Return the place fields: number, centre, arc length on the path, radius."""
    places = np.column_stack([fields.centres, fields.arcs(fields.centres)]).tolist()
    rows = (
        [i, *(f"{value:.6g}" for value in (*place, fields.radius))]
        for i, place in enumerate(places, 1)
    )
    return csv_text(["field", "x", "y", "arc", "radius"], rows)


def cycles_csv(laps: Sequence[Lap], unit: str) -> str:
    """Return what the queues hold: a row per method, step and offset."""
    count = laps[0].cycles.activity.shape[2]
    header = ["method", "step", "offset", "state", "phase_deg"]
    header += [f"error_{unit}", f"spread_{unit}"]
    return csv_text([*header, *(f"field_{i + 1}" for i in range(count))], _rows(laps))


def _rows(laps: Iterable[Lap]) -> Iterable[list[object]]:
    for lap in laps:
        cycles = lap.cycles
        phases = [f"{phase:.6g}" for phase in cycles.phases.tolist()]
        values = np.dstack([cycles.error, cycles.spread, cycles.activity])
        for t, column in np.argwhere(cycles.held).tolist():
            k = column - cycles.reach
            numbers = (f"{value:.4g}" for value in values[t, column].tolist())
            yield [lap.name, t, k, t + k, phases[column], *numbers]


def _number(value: float, style: str = ".2f") -> str:
    return _NONE if math.isnan(value) else format(value, style)
