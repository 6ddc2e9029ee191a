"""From laps to the figure, the data and the page."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.files import own_folder, write_part
from benchmarks.phase.cycles import cycles_of, perfect_cycles
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.page import cycles_csv, fields_csv, page, table
from benchmarks.phase.precession import PERFECT, Lap
from benchmarks.pictures.plots import require_plots
from benchmarks.trials.episode import room_of, trial_moments
from benchmarks.trials.spec import Trial
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.validation import InputError, integer

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
    from benchmarks.phase.figure import phase_figure

    room = room_of(trials[0].scenario)
    if not isinstance(room, RoomEnv) or room.world.route is not None:
        raise InputError(
            f"the scenario {trials[0].scenario} has no lap, along which place fields lie: choose "
            "one that has."
        )
    own_folder(out, "phase")
    path = room.course.path
    unit, start = room.floor_plan.unit, path.arc(room.course.start[:2])
    places = PlaceFields.along(path, fields, start, unit)
    laps = _laps(trials, places, most=2 * len(room.course.actions))  # a driver gives up after two
    contents = {
        "cycles.csv": cycles_csv(laps, unit).encode(),
        "fields.csv": fields_csv(places).encode(),
        "phase.png": phase_figure(laps, places, room.floor_plan, title),
        "phase.md": page(title, laps, places, command).encode(),
    }
    write_part(out, "phase", contents)
    return f"{title}\n\n{table(laps, places, 'simple')}\n\nWritten to {out}: {', '.join(contents)}."


def _laps(trials: Sequence[Trial], fields: PlaceFields, *, most: int) -> list[Lap]:
    """Return the lap of a perfect queue, then that of each localizer; the world is the same."""
    laps = []
    for trial in trials:
        lap = ((moment.truth, moment.belief) for moment in trial_moments(trial))
        laps.append(Lap(trial.localizer, cycles_of(lap, fields, trial.lag, most=most)))
    perfect = perfect_cycles(laps[-1].cycles.truth, fields, trials[0].lag)
    return [Lap(PERFECT, perfect), *laps]
