"""``deqmcl phase``: from what can be told to the files written."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.phase.cycles import Cycles, cycles_of, perfect_cycles
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.figure import Panel, phase_figure
from benchmarks.phase.page import PERFECT, cycles_csv, fields_csv, page, table, told
from benchmarks.phase.precession import precession
from benchmarks.pictures.plots import require_plots
from benchmarks.sweeps.store import writable_folder, write_bytes
from benchmarks.sweeps.suites import paper_suite
from benchmarks.tables.table_1 import TITLES
from benchmarks.trials.episode import check_params, room_of, trial_moments
from benchmarks.trials.presets import ASSUMED
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError, integer, one_of
from localizers import names, resolve

METHODS = ("mcl", "mcl-smoother", "deq-mcl", "deq-mcl-rejuvenated")


@dataclass(frozen=True, kw_only=True)
class PhaseRun:
    """What ``deqmcl phase`` can be told. Checked as a whole before anything is run or written."""

    localizers: tuple[str, ...] = METHODS
    fields: int = 12
    preset: str = "paper"
    seed: int = 0
    particles: int = 1000
    lag: int = 20

    def __post_init__(self) -> None:
        one_of("preset", self.preset, ASSUMED)
        if not self.localizers:
            raise InputError(f"no localizer is named: allowed are {', '.join(names())}.")
        for name in self.localizers:
            resolve(name)
        if len(set(self.localizers)) < len(self.localizers):
            raise InputError(f"a localizer is named twice in {', '.join(self.localizers)}.")
        integer("--fields", self.fields, low=2, high=100)
        integer("--seed", self.seed)
        integer("--particles", self.particles, low=1)
        integer("--lag", self.lag)

    @property
    def trials(self) -> list[Trial]:
        """Trial 0 of the paper's experiment with these parameters, for each localizer."""
        return paper_suite(
            preset=self.preset,
            localizers=self.localizers,
            trials=1,
            seed=self.seed,
            lag=self.lag,
            particles=self.particles,
        )

    @property
    def title(self) -> str:
        """The setting in words."""
        return (
            f"The queue as theta phase: preset {self.preset}, N = {self.particles}, "
            f"L = {self.lag}, seed {self.seed}"
        )


def run_phase(run: PhaseRun, out: Path, command: Sequence[str]) -> str:
    """Run a lap of each localizer; write figure, data and page; return what to print."""
    require_plots()
    for trial in run.trials:
        check_params(trial)
    writable_folder(out)
    room = room_of(run.preset)
    path = room.course.path
    fields = PlaceFields.along(path, run.fields, start=path.arc(room.course.start[:2]))
    perfect, laps = _laps(run, fields)
    panels = [_panel(name, cycles) for name, cycles in laps.items()]
    first = _panel(PERFECT, perfect)
    picture = phase_figure(first, panels, fields, room.floor_plan, run.title)
    rows = {panel.title: panel.precession for panel in (first, *panels)}
    contents = {
        "cycles.csv": cycles_csv({PERFECT: perfect} | laps).encode(),
        "fields.csv": fields_csv(fields).encode(),
        "phase.png": picture,
        "phase.md": page(run.title, rows, fields, command).encode(),
    }
    for name, content in contents.items():
        write_bytes(out / name, content)
    return f"{run.title}\n\n{table(rows, 'simple')}\n\nWritten to {out}: {', '.join(contents)}."


def _laps(run: PhaseRun, fields: PlaceFields) -> tuple[Cycles, dict[str, Cycles]]:
    """Return the lap of a perfect queue and that of each localizer; the world is the same."""
    laps: dict[str, Cycles] = {}
    for trial in run.trials:
        episode = list(trial_moments(trial))
        laps[trial.localizer] = cycles_of(episode, fields, run.lag)
    truth = np.array([moment.truth for moment in episode])
    return perfect_cycles(truth, fields, run.lag), laps


def _panel(name: str, cycles: Cycles) -> Panel:
    found = precession(cycles)
    title = TITLES.get(name, name)
    return Panel(
        title=title[:1].upper() + title[1:],
        words=told(found),
        cycles=cycles,
        precession=found,
    )
