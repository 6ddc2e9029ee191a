"""What a log is replayed with, as overrides of the scenario ``replay``; and in words."""

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.setup import documents
from benchmarks.setup.documents import parsed
from benchmarks.setup.logs import REPLAY, LogScenario, check_inside, motion_noise, shows_noise
from benchmarks.setup.names import absolute_assumed
from benchmarks.setup.overrides import NOTHING, Overrides, file_names
from benchmarks.setup.priors import Gaussian
from benchmarks.trials.tracks import absolute
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.logs import Log, LogWarning, Trajectory, referenced
from deqmcl_gym.logs.trajectory import tolerance_of
from deqmcl_gym.maps.map import metre
from deqmcl_gym.validation import InputError, one_of, pose
from localizers import OmniMotion, RobotModel
from localizers.models.nav2_motion import MotionModel, kind_of

SCENARIO = "replay"
EVERY = "0.2m,5deg"
OFTEN = "0.0625m,3deg"  # for Nav2's AMCL, which waits for 0.25 m or 0.2 rad itself
NO_ERROR = (
    "There is no reference, so no error is known. The share of beams that agree with the map is no "
    "substitute: a wrong place that looks alike agrees equally well."
)
_DEFAULTS = {"world.unknown": "obstacle", "world.every": EVERY, "world.max_beams": 60}
_PARTS = ("world", "assumed", "params")
_SIDEWAYS = 0.1  # share of the way above which a warning is given; 1 to 2 % in two real logs
_UNKNOWN = {
    "obstacle": "obstacles, which stop beams and the robot",
    "transparent": "transparent, they stop the robot but no beam",
    "free": "free, they stop neither beams nor the robot",
}


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The scenario ``replay`` with changes, as a sweep has them, and what is to be said of them."""

    world: Overrides  # the changes, by dotted name
    assumed: Overrides  # likewise
    noise: str  # where that of the motion is from
    reference: str  # where the true poses are from, in words; "" without any
    power: str = ""  # how the power of the scan model was fitted, in words; "" if it was not

    @property
    def scenario(self) -> LogScenario:
        """The scenario with the changes."""
        return REPLAY.changed(self.world, self.assumed)

    @property
    def log(self) -> Log:
        """The records that are played."""
        return self.scenario.recording()[0]

    @property
    def motion(self) -> MotionModel:
        """What the localizers assume of the odometry."""
        return self.scenario.motion_of(self.log)

    @property
    def overview(self) -> str:
        """What is played."""
        log, every = self.log, self.world["every"]
        distance, angle = spacing("every", every, log.unit)
        interval = f"{distance:g} {log.unit} or {math.degrees(angle):.3g}° apart"
        return (
            f"{len(log):,} records of {file_names(self.world['log'])}, {interval}, with "
            f"{log.scanner.beams} beams each on the map {Path(self.world['map']).name}, "
            f"{log.driven[-1]:,.0f} {log.unit} by odometry."
        )

    @property
    def facts(self) -> list[str]:
        """What the localizers assume."""
        setup, log = self.scenario, self.log
        motion = ", ".join(f"{name} {value:.3g}" for name, value in vars(self.motion).items())
        places = log.scanner.places
        at = " and ".join(f"({x:g}, {y:g})" for x, y in np.round(places, 4) + 0.0)
        mounted = f" The scanner is mounted at {at} {log.unit} on it, ahead and left."
        changed = values_among(self.world, "changed_walls.")
        walls = ", ".join(f"{name} {value}" for name, value in changed.items())
        facts = [
            f"Motion model: {kind_of(self.motion)}, {motion} ({self.noise}).",
            f"Scan model: {setup.scan}. Radius of the robot: {setup.room().radius:g} {log.unit}. "
            f"Unless you give a method its β, a step that collides costs β = {setup.beta:g}: "
            f"{RobotModel.beta:g} times the power of the scan model.",
            self.power,
            f"Unknown cells of the map: {_UNKNOWN[self.world['unknown']]}.",
            f"The map's walls are changed on purpose ({walls})." if walls else "",
            self._start,
            "Poses are of the robot's base (ROS: base_link): the start, the reference and "
            f"tracks/*.tum.{mounted if any(map(any, places)) else ''}",
            self.reference or NO_ERROR,
        ]
        return [fact for fact in facts if fact]

    @property
    def sideways(self) -> str | None:
        """The warning that the odometry moves the robot sideways; None if it hardly does."""
        log = self.log
        aside, driven = float(np.abs(log.residuals).sum()), float(log.driven[-1])
        if isinstance(self.motion, OmniMotion) or aside <= _SIDEWAYS * driven:
            return None
        return (
            f"{aside:.1f} of {driven:.1f} {log.unit} of odometry are sideways: for a robot that "
            "can move so, add --set assumed.motion.kind=omni; for one that cannot, its odometry is "
            "not of the point between its wheels, or the wheels slip."
        )

    @property
    def _start(self) -> str:
        prior = self.scenario.prior
        if type(prior) is not Gaussian:
            settings = values_among(self.assumed, "prior.")
            if settings == {"kind": "uniform"}:
                return "Start: anywhere on the map."
            return f"Start: {', '.join(f'prior.{n} {value}' for n, value in settings.items())}."
        around = "the reference's first pose"
        if (at := prior.mean or self.log[0].reference) is not None:
            x, y, heading = at
            around = f"({x:z.2f}, {y:z.2f}, {heading:z.2f} rad)"
        return (
            f"Start: known to {prior.sd_position:g} {self.log.unit} and {prior.sd_heading:g} rad, "
            f"around {around}."
        )


def replay_of(
    log: str | Path | Sequence[str | Path],
    floor_plan: str | Path,
    *,
    reference: str | Path | None = None,
    start: str | Sequence[float] | None = None,
    otherwise: str | Sequence[float] | None = None,
    settings: Mapping[str, Any] = NOTHING,
) -> Replay:
    """Return what is to be replayed: a log, or its parts, with the map's yaml and a TUM reference.

    Args:
        start: "reference", "global", a pose of the robot (or "x,y,θ"), "room=x,y,x,y,…",
            "near=x,y,within" or the path of a TOML file with a table [prior]; None is the reference
            if there is one.
        otherwise: the start of a log without a reference, if none is given.
        settings: by name, arguments of ``LogEnv`` (world.every, world.max_beams, world.radius,
            world.unknown, world.changed_walls.…, and in world.reading.… those of ``logs.read``)
            and what localizers assume (assumed.motion.…, assumed.scan.…, assumed.prior.…); of the
            motion, what is not given is estimated from the reference, if there is one.
    """
    env, assumptions = _parts(_DEFAULTS | dict(settings))
    for name in ("log", "map", "reference"):
        if name in env:
            raise InputError(f"world.{name} is set beside the log that is given: leave one out.")
    if "segment" in env:
        raise InputError("world.segment is for sweeps over a log: here the whole log is played.")
    parts = [log] if isinstance(log, str | Path) else log
    named = ", ".join(map(str, parts))
    world: dict[str, Any] = {
        "log": tuple(map(os.path.abspath, parts)) if len(parts) > 1 else os.path.abspath(parts[0]),
        "map": os.path.abspath(floor_plan),
        **({} if reference is None else {"reference": os.path.abspath(reference)}),
        **env,
    }
    whole = REPLAY.changed(world).whole
    if start is None:
        start = "reference" if whole.reference is not None else otherwise
    if start is None and not any(name.startswith("prior.") for name in assumptions):
        raise InputError(
            f"{named} has no reference: give --reference, --start x,y,θ or --start global."
        )
    if start == "reference":
        if not whole.referenced.size:
            raise InputError(f"--start is reference, but {named} has none: give --reference.")
        world.setdefault("start", int(whole.referenced[0]))
    played, ground = REPLAY.changed(world).recording()
    check_inside(played, ground)
    prior: dict[str, Any] = {}
    at, where, remedy = played[0].reference, "the reference begins at", "--start=x,y,θ"
    if start != "reference":
        prior = {} if start is None else _start_of(start)
        at = prior["prior.mean"] if prior.keys() == {"prior.mean"} else None
        where, remedy = "--start is", "a pose where the robot can be"
    if at is not None and not ground.free(np.array([at]))[0]:
        raise InputError(
            f"{where} ({at[0]:g}, {at[1]:g}), but that is no free space on the map: give {remedy}."
        )
    assumed, origin = _with_noise(world, absolute_assumed(Overrides(assumptions)), played)
    rest = whole.segment(world.get("start", 0))
    return Replay(
        world=Overrides(world),
        assumed=Overrides(prior | assumed),
        noise=origin,
        reference=_reference(rest, played, world.get("reading.reference_tolerance")),
    )


def values_among(settings: Mapping[str, Any], head: str = "params.") -> dict[str, Any]:
    """Return the settings whose names begin with ``head``, by the rest of their names."""
    return {n.removeprefix(head): value for n, value in settings.items() if n.startswith(head)}


def _parts(settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what is set of the world, and of what localizers assume."""
    parts: dict[str, dict[str, Any]] = {part: {} for part in _PARTS}
    for name, value in settings.items():
        part, _, rest = name.partition(".")
        if not rest or part not in parts:
            one_of("name of a setting on a log", name, [f"{part}.…" for part in _PARTS])
        if name.startswith("world.reading.scanner"):
            raise InputError(
                "world.reading takes no scanner: write it into the file, as "
                '# {"angles": [-1.57, 0, 1.57], "max_range": 8} in the first line of a CSV.'
            )
        model = name.startswith(("assumed.motion.", "assumed.scan."))
        parts[part][rest] = float(value) if model and type(value) is int else value
    return parts["world"], parts["assumed"]


def _with_noise(
    world: Mapping[str, Any], assumed: Mapping[str, Any], played: Log
) -> tuple[dict[str, Any], str]:
    """Return what is assumed, with the noise of the motion that is not given, and its origin."""
    noise, values = REPLAY.changed(world, assumed).motion, dict(assumed)
    values |= {f"motion.{name}": value for name, value in values.pop("motion", {}).items()}
    names = [f"motion.{name}" for name in vars(noise)]
    fixed = [name.partition(".")[2] for name in values if name in names]
    if {*names} - {"motion.still"} <= values.keys():
        return values, "given"
    estimated = vars(motion_noise(played, kind_of(noise))) if shows_noise(played) else {}
    origin = "assumed, as there is no reference"
    if estimated:
        origin = "of the log's odometry against its reference, at least half of Nav2's defaults"
    elif played.reference is not None:
        origin = "assumed, as too few records that move have a reference pose of their own time"
    if fixed:
        values = {f"motion.{name}": value for name, value in estimated.items()} | values
        origin = f"{', '.join(fixed)} given; the rest {origin}"
    return values, origin


def _start_of(start: str | Sequence[float]) -> dict[str, Any]:
    """Return a start as assumptions: a prior, or the mean of one."""
    if isinstance(start, str) and start.endswith(".toml"):
        table = documents.read_toml(Path(start), "prior")
        with documents.errors_name(Path(start)):
            documents.check_values(table, ["prior"])
            return dict(Overrides.told("prior", {"prior": table.get("prior", {})}))
    if start == "global":
        return {"prior.kind": "uniform"}
    word, equals, text = start.rpartition("=") if isinstance(start, str) else ("", "", start)
    value = parsed("--start", text) if isinstance(text, str) else text
    numeric = isinstance(value, list | tuple) and all(isinstance(n, int | float) for n in value)
    numbers = list(map(float, value)) if numeric else []
    if word == "room" and len(numbers) >= 6 and len(numbers) % 2 == 0:
        corners = tuple(zip(numbers[::2], numbers[1::2], strict=True))
        return {"prior.kind": "uniform", "prior.polygon": corners}
    if word == "near" and len(numbers) in (3, 4):
        within = dict(zip(("prior.within", "prior.beyond"), numbers[2:], strict=False))
        return {"prior.kind": "uniform", "prior.near": tuple(numbers[:2]), **within}
    if equals or len(numbers) != 3:
        raise InputError(
            f"--start is {start!r}, but must be reference, global, a pose x,y,θ in m and rad, as "
            "in --start=-1.5,2,0.3, room=x,y,x,y,x,y,… with the corners of a polygon, "
            "near=x,y,within or near=x,y,within,beyond, all in m, or a .toml file."
        )
    return {"prior.mean": pose("--start", numbers)}


def _reference(whole: Log, played: Log, tolerance: float | None) -> str:
    """Say how many of the records played have a reference pose, and how good those between are."""
    count = played.referenced.size
    if not count:
        return ""
    within = tolerance_of(played, tolerance)
    between = count - played.posed.size
    counts = [
        f"{played.posed.size:,} of {len(played):,} records have a pose within "
        f"{1000 * within:.3g} ms of their own time"
    ]
    if between:
        counts.append(
            f"for {between:,} it is interpolated along the odometry, whose error is spread over "
            "the way between two poses"
        )
    if unknown := len(played) - count:
        counts.append(f"{unknown:,} without one do not count")
    sentence = f"Reference: {'; '.join(counts)}."
    return sentence + _interpolated_words(whole) if between else sentence


def _interpolated_words(log: Log) -> str:
    """Say how far off every second reference pose is if it is interpolated; "" if that is none."""
    at, size = log.posed, metre(log.unit)
    if log.reference is None or at.size < 3:
        return ""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LogWarning)  # of few records: half of them are left out
        half = referenced(log, Trajectory(log.times[at[::2]], log.reference[at[::2]]))
    hidden = at[1:-1:2]
    assert half.reference is not None
    if not np.isfinite(half.reference[hidden]).any():
        return ""
    off = absolute(log.reference[hidden], half.reference[hidden])
    position = np.quantile(off.translation, (0.5, 0.95)) / size
    heading = np.degrees(np.quantile(off.rotation, (0.5, 0.95)))
    return (
        " Every second pose, left out and interpolated from its neighbours, is off by "
        f"{position[0]:.3f} m and {heading[0]:.1f}° (median), {position[1]:.3f} m and "
        f"{heading[1]:.1f}° (95 %): errors of that size may be the reference's."
    )
