"""The paper's figures 4 and 5 and an animation of the lap, always of world 0: no picking.

Curves are by matplotlib, an optional extra.
"""

import io
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.files import write_files
from benchmarks.pictures import styled
from benchmarks.pictures.film import Camera, png, side_by_side, webp
from benchmarks.trials.clouds import belief_moments, cloud_of, joined
from benchmarks.trials.episode import Step
from benchmarks.trials.metrics import state_error
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics.types import Floats, Indices, Reals
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.drawing import Drawing, View
from localizers import Belief

if TYPE_CHECKING:  # it may not be installed
    from matplotlib.figure import Figure


def require_plots() -> None:
    """Refuse to go on without matplotlib.

    Raises:
        InputError: naming the pip command.
    """
    if find_spec("matplotlib") is None:
        raise InputError(
            "plots need matplotlib, which is not installed: pip install 'deqmcl-gym[plots]'."
        )


@styled()
def error_plot(curves: Mapping[str, tuple[Indices, Floats]], title: str, words: str) -> bytes:
    """Return error curves over the state's step as PNG; ``words`` say what error and its unit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), dpi=120, layout="constrained")
    axes = figure.subplots()
    for name, (states, errors) in curves.items():
        color = "orange" if name == "x[t]" else "pink" if "-" in name else "blue"
        axes.plot(states, errors, label=f"belief about {name}", color=f"tab:{color}")
    axes.set(xlabel="step of the state estimated", ylabel=words, title=title, ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend()
    return png_of(figure)


def png_of(figure: "Figure", **how: Any) -> bytes:
    """Return a figure as PNG, the same bytes each time; ``how`` is for ``savefig``."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, **how)
    return buffer.getvalue()


FIG_4_METHODS = ("deq-mcl", "mcl")
FIG_5_METHOD = "deq-mcl"
FIG_5_STATE = 150  # the paper's
LAP_METHODS = ("mcl", "deq-mcl")
_SHOWN = {*FIG_4_METHODS, FIG_5_METHOD, *LAP_METHODS}
PAPER_FIGURES = {  # by how the file's name begins: heading, what is to be seen
    **{
        f"fig4_{method}": (
            f"Figure 4: half-way round, {method}",
            "Particles about the present, orange; with a queue also about the past, pink, and the "
            "future, light blue. Cross: the estimate, their mean. Line: the plan, from the robot.",
        )
        for method in FIG_4_METHODS
    },
    f"fig5_step{FIG_5_STATE}": (
        f"Figure 5: state {FIG_5_STATE} when it is present",
        "The belief about it is orange. Its particles were drawn L steps earlier, as a future.",
    ),
    "fig5_step": (
        f"Figure 5: state {FIG_5_STATE}, looked back at",
        "The belief about the same state is pink now; the ring is where the robot was. No new "
        "particles were drawn: those that later scans contradict are gone, copies of others stand "
        "in their places. So the SD shrinks; the error does only if the right ones are left.",
    ),
    "lap": ("The lap", "As figure 4, every 4th step."),
}
LAP_STRIDE = 4  # steps per frame
LAP_MILLISECONDS = 120
_LONGEST = 560.0  # px of the paper's room
_LEAST_SCALE = 0.01


def camera_of(stage: Stage, scale: float = 1.6) -> Camera:
    """Return a camera for the room of a trial, set up.

    A building is drawn smaller: 560 image pixels times the scale are the most to a side.
    """
    room = stage.room
    x0, y0, x1, y1 = room.floor_plan.bounds
    longest = max(x1 - x0, y1 - y0)
    size = scale * min(longest / pixel(room.floor_plan.unit), _LONGEST)
    small = View(room.floor_plan, scale * _LEAST_SCALE)  # a map of cells has a scale of its own
    view = View(room.floor_plan, small.scale * size / (longest * small.per_length))
    ground = room.picture if isinstance(room, RoomEnv) else Drawing
    return Camera(view, room.radius, stage.trial.lag, ground)


def write_paper_figures(shown: Sequence[Trial], folder: Path) -> list[Path]:
    """Draw the figures of the trials that are ``chosen``."""
    return write_files(folder, figures_of(shown))


def chosen(trials: Sequence[Trial]) -> list[Trial]:
    """Return trial 0 of each method that is shown."""
    return [t for t in trials if (t.trial, t.filter_seed) == (0, 0) and t.localizer in _SHOWN]


def figures_of(trials: Sequence[Trial]) -> dict[str, bytes]:
    """Draw what can be drawn of these methods, each given by its trial 0, by file name."""
    stages = [Stage.of(trial) for trial in trials]
    seen = {s.trial.localizer: (camera_of(s), list(s.moments())) for s in stages}
    contents: dict[str, bytes] = {}
    for method in FIG_4_METHODS:
        if method in seen:
            camera, episode = seen[method]
            half_way = episode[(len(episode) - 1) // 2]
            contents[f"fig4_{method}.png"] = png(camera.frame(half_way, [method]))
    if FIG_5_METHOD in seen:
        contents |= _fig_5(*seen[FIG_5_METHOD])
    shown = [method for method in LAP_METHODS if method in seen]
    if shown:
        small = camera_of(stages[0], scale=1.2)
        laps = [
            [small.frame(moment, [method]) for moment in seen[method][1][::LAP_STRIDE]]
            for method in shown
        ]
        frames = [side_by_side(row) for row in zip(*laps, strict=True)]
        contents["lap.webp"] = webp(frames, LAP_MILLISECONDS)
    return contents


def _fig_5(camera: Camera, episode: Sequence[Step]) -> dict[str, bytes]:
    """State 150 seen at step 150, and looked back at L steps later, with its error and spread."""
    later = FIG_5_STATE + camera.lag
    if later >= len(episode):
        return {}
    images = {}
    truth, unit = episode[FIG_5_STATE].truth, camera.view.floor_plan.unit
    for step, offset in ((FIG_5_STATE, 0), (later, -camera.lag)):  # the same if L = 0
        seen = _error_and_spread(episode[step].belief, offset, truth, unit)
        words = [f"{FIG_5_METHOD}, state {FIG_5_STATE} seen at step {step}", seen]
        frame = camera.frame(episode[step], words, truth if offset else None)
        images[f"fig5_step{step}.png"] = png(frame)
    return images


def _error_and_spread(belief: Belief, offset: int, truth: Reals, unit: str) -> str:
    points = belief.points(offset)
    if points is None:
        return "n/a"
    (row,) = belief_moments(joined([cloud_of(FIG_5_STATE, offset, points)], [truth]))
    error = state_error(row[None, :4], truth[None])[0]
    return f"error {error:.1f}, SD {(row[4] + row[5]) ** 0.5:.1f} {unit}"
