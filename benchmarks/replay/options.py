"""What a user says about a replay, as changes to the scenario ``replay``; and in words."""

import math
import os
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.setup import documents
from benchmarks.setup.changes import NOTHING, Changes, file_names
from benchmarks.setup.logs import ReplayScenario, check_inside, motion_noise, shows_noise
from benchmarks.setup.names import absolute_assumed, scenario
from benchmarks.setup.priors import Gaussian
from benchmarks.trials.tracks import absolute
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.logs import Log, LogWarning, Trajectory, referenced
from deqmcl_gym.logs.trajectory import tolerance_of
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics.types import Floats, Pose
from deqmcl_gym.validation import InputError, number, pose
from localizers import OmniMotion, RobotModel
from localizers.models.nav2_motion import MotionModel, kind_of

NAME = "replay"  # of the scenario
EVERY = "0.2m,5deg"
OFTEN = "0.0625m,3deg"  # for Nav2's AMCL, which waits for 0.25 m or 0.2 rad itself
NO_ERROR = (
    "There is no reference, so no error is known. The share of beams that agree with the map is no "
    "substitute: a wrong place that looks alike agrees equally well."
)
_SIDEWAYS = 0.1  # share of the way above which sideways motion is told; 1 to 2 % in two real logs
_UNKNOWN = {
    "obstacle": "obstacles, which stop beams and the robot",
    "transparent": "transparent, they stop the robot but no beam",
    "free": "free, they stop neither beams nor the robot",
}


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The scenario ``replay`` with changes, as a sweep has them, and what is to be said of them.

    Attributes:
        world, assumed: the changes, by dotted name.
        noise: where that of the motion is from.
        reference: where the true poses are from, in words; "" without any.
        beams: how the beam model was fitted, in words; "" if it was not.
        calibration: how the power of the scan model was fitted, in words; "" if it was not.
    """

    world: Changes
    assumed: Changes
    noise: str
    reference: str
    beams: str = ""
    calibration: str = ""

    @property
    def scenario(self) -> ReplayScenario:
        """The scenario with the changes."""
        return _replayed(self.world, self.assumed)

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
        apart = f"{distance:g} {log.unit} or {math.degrees(angle):.3g}° apart"
        return (
            f"{len(log):,} records of {file_names(self.world['log'])}, {apart}, with "
            f"{log.scanner.beams} beams each on the map {Path(self.world['map']).name}, "
            f"{log.driven[-1]:,.0f} {log.unit} by odometry."
        )

    @property
    def facts(self) -> list[str]:
        """What the localizers assume."""
        setup, log = self.scenario, self.log
        motion = ", ".join(f"{name} {value:.3g}" for name, value in vars(self.motion).items())
        places = log.scanner.places
        said = " and ".join(f"({x:g}, {y:g})" for x, y in places)
        mounted = f" The scanner is mounted at {said} {log.unit} on it, ahead and left."
        told = [
            f"Motion model: {kind_of(self.motion)}, {motion} ({self.noise}).",
            f"Scan model: {setup.scan}. Radius of the robot: {setup.room().radius:g} {log.unit}. "
            f"A step that collides is charged β = {setup.beta:g} by methods that are given no β: "
            f"{RobotModel.beta:g} times the power of the scan model.",
            self.beams,
            self.calibration,
            f"Unknown cells of the map: {_UNKNOWN[self.world['unknown']]}.",
            self._changed,
            self._start,
            "Poses are of the robot's base (ROS: base_link): the start, the reference and "
            f"tracks/*.tum.{mounted if any(map(any, places)) else ''}",
            self.reference or NO_ERROR,
        ]
        return [fact for fact in told if fact]

    @property
    def sideways(self) -> str | None:
        """The warning that the odometry moves the robot sideways; None if it hardly does."""
        log = self.log
        aside, driven = float(np.abs(log.residuals).sum()), float(log.driven[-1])
        if isinstance(self.motion, OmniMotion) or aside <= _SIDEWAYS * driven:
            return None
        return (
            f"{aside:.1f} of {driven:.1f} {log.unit} of odometry are sideways: for a robot that "
            "can move so, add --motion kind=omni; for one that cannot, its odometry is not of the "
            "point between its wheels, or the wheels slip."
        )

    @property
    def _changed(self) -> str:
        """What is changed of the map, in words; "" if nothing is."""
        of_it = {
            name.partition(".")[2]: value
            for name, value in self.world.items()
            if name.startswith("changed_walls.")
        }
        if not of_it:
            return ""
        told = ", ".join(f"{name} {value}" for name, value in of_it.items())
        return f"The map's walls are changed on purpose ({told})."

    @property
    def _start(self) -> str:
        prior = self.scenario.prior
        if type(prior) is not Gaussian:
            return f"Start: {prior.where}."
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
    reading: Mapping[str, Any] | None = None,
    start: str | None = None,
    otherwise: str | None = None,
    every: str | tuple[float, float] = EVERY,
    max_beams: int = 60,
    motion: str = "",
    scan: str = "",
    radius: float | None = None,
    unknown: str = "obstacle",
    changed_walls: str = "",
) -> Replay:
    """Return what is to be replayed.

    Args:
        log: path of the log, or of its parts.
        floor_plan: path of the map's yaml.
        reference: path of a TUM file.
        reading: further arguments of ``logs.read``.
        start: "reference", "global", "x,y,θ" of the robot, "room=x,y,x,y,…", "near=x,y,within" or
            the path of a TOML file with a table [prior]; None is the reference if there is one.
        otherwise: the start of a log without a reference, if none is said.
        every, max_beams, unknown: see ``LogEnv``.
        motion: "kind=differential,alpha1=…"; what is not given is estimated from the reference, if
            there is one.
        scan: values of a beam model, as in "kind=beam-model,sigma=0.2,power=0.5".
        radius: of the robot, m; None is 0.16 m.
        changed_walls: of the map that localizers are given, as in "share=0.3,seed=1".

    Raises:
        InputError: something of it is refused.
    """
    parts = [log] if isinstance(log, str | Path) else log
    world: dict[str, Any] = {
        "log": tuple(map(os.path.abspath, parts)) if len(parts) > 1 else os.path.abspath(parts[0]),
        "map": os.path.abspath(floor_plan),
        **({} if reference is None else {"reference": os.path.abspath(reference)}),
        **{f"reading.{name}": value for name, value in (reading or {}).items()},
        "unknown": unknown,
        "every": every,
        "max_beams": max_beams,
        **_changes(changed_walls),
    }
    whole = _replayed(world).whole
    if radius is not None:
        world["radius"] = number("--radius", radius, low=0) * metre(whole.unit)
    if start is None:
        start = "reference" if whole.reference is not None else otherwise
    if start is None:
        raise InputError(
            f"{log} has no reference: give --reference, --start x,y,θ or --start global."
        )
    if start == "reference":
        if not whole.referenced.size:
            raise InputError(f"--start is reference, but {log} has none: give --reference.")
        world["start"] = first_referenced(whole)
    played, ground = _replayed(world).recording()
    check_inside(played, ground)
    if start == "reference" and (at := played[0].reference) is not None:
        _check_free(ground, at, "the reference begins at", "the reference of this log and map")
    assumed = {**_assumed("motion", motion), **absolute_assumed(Changes(_assumed("scan", scan)))}
    assumed, origin = _with_noise(world, assumed, played)
    if (prior := _prior_of(start)) is not None:
        assumed |= prior
    elif start != "reference":
        at = _pose_of(start)
        _check_free(ground, at, "--start is", "a pose where the robot can be")
        assumed["prior.mean"] = at
    tolerance = (reading or {}).get("reference_tolerance")
    said = _reference(whole.segment(world.get("start", 0)), played, tolerance)
    return Replay(world=Changes(world), assumed=Changes(assumed), noise=origin, reference=said)


def _check_free(ground: Map, at: Pose, what: str, remedy: str) -> None:
    """Refuse a start that is no free space."""
    if not ground.free(np.array([at]))[0]:
        raise InputError(
            f"{what} ({at[0]:g}, {at[1]:g}), but that is no free space on the map: give {remedy}."
        )


def _with_noise(
    world: Mapping[str, Any], assumed: Mapping[str, Any], played: Log
) -> tuple[dict[str, Any], str]:
    """Return what is assumed, with the noise of the motion that is not given, and its origin."""
    noise = _replayed(world, assumed).motion
    names = {f"motion.{name}" for name in vars(noise)}
    told = [name.partition(".")[2] for name in assumed if name in names]
    if names - {"motion.still"} <= assumed.keys():
        return dict(assumed), "given"
    estimated: dict[str, Any] = {}
    if shows_noise(played):
        origin = "of the log's odometry against its reference, at least half of Nav2's defaults"
        estimated = {
            f"motion.{n}": v for n, v in vars(motion_noise(played, kind_of(noise))).items()
        }
    elif played.reference is not None:
        origin = "assumed, as too few records that move have a reference pose of their own time"
    else:
        origin = "assumed, as there is no reference"
    if told:
        return {**estimated, **assumed}, f"{', '.join(told)} given; the rest {origin}"
    return dict(assumed), origin


def first_referenced(whole: Log) -> int:
    """Return the record at which a log is begun: its first with a reference pose; 0 if none has."""
    return int(whole.referenced[0]) if whole.referenced.size else 0


def length_and_angle(option: str, text: str) -> tuple[float, float]:
    """Return metres and rad of "0.5m,15deg".

    Raises:
        InputError: it has another form, or only one of them.
    """
    length, angle = spacing(option, text, "m")
    if not (math.isfinite(length) and math.isfinite(angle)):
        raise InputError(f'{option} is {text!r}, but must have both, as in "0.5m,15deg".')
    return length, angle


def reading_of(words: Sequence[str]) -> dict[str, Any]:
    """Return NAME=VALUE words as arguments of ``logs.read``.

    Raises:
        InputError: a word of another form.
    """
    found: dict[str, Any] = {}
    form = "NAME=VALUE, as scan_topic=/front"
    for name, value in _pairs("--read", words, form, often=("scan_topic",)):
        if name == "scanner":
            raise InputError(
                "--read takes no scanner: write it into the file, as "
                '# {"angles": [-1.57, 0, 1.57], "max_range": 8} in the first line of a CSV.'
            )
        if name == "scan_topic" and name in found:
            found[name] = (
                *(found[name] if isinstance(found[name], tuple) else (found[name],)),
                value,
            )
            continue
        numbers = None if name.endswith(("_topic", "_frame")) else _numbers(value)
        one = numbers[0] if numbers is not None and len(numbers) == 1 else numbers
        if name == "odometry_publisher" and isinstance(one, float) and one.is_integer():
            one = int(one)
        found[name] = value if one is None else one
    return found


def _replayed(world: Mapping[str, Any], assumed: Mapping[str, Any] = NOTHING) -> ReplayScenario:
    found = scenario(NAME).changed(world, assumed)
    assert isinstance(found, ReplayScenario)
    return found


def _prior_of(start: str) -> dict[str, Any] | None:
    """Return a start that is no single pose, as assumptions; None of a pose."""
    if start.endswith(".toml"):
        given = documents.read(Path(start), "prior")
        with documents.errors_name(Path(start)):
            documents.check(given, ["prior"])
            return dict(Changes.told("prior", {"prior": given.get("prior", {})}))
    word, _, text = start.partition("=")
    if word not in ("global", "room", "near"):
        return None
    found: dict[str, Any] = {"prior.kind": "uniform"}
    numbers = _numbers(text) or []
    if word == "room" and len(numbers) >= 6 and len(numbers) % 2 == 0:
        found["prior.polygon"] = tuple(zip(numbers[::2], numbers[1::2], strict=True))
    elif word == "near" and len(numbers) in (3, 4):
        found |= {"prior.near": tuple(numbers[:2]), "prior.within": numbers[2]}
        found |= {"prior.beyond": numbers[3]} if len(numbers) == 4 else {}
    elif start != "global":
        raise InputError(
            f"--start is {start!r}, but must be room=x,y,x,y,x,y,… with the corners of a polygon, "
            "or near=x,y,within or near=x,y,within,beyond, all in m."
        )
    return found


def _pose_of(start: str) -> tuple[float, float, float]:
    given = _numbers(start)
    if given is None or len(given) != 3:
        raise InputError(
            f"--start is {start!r}, but must be reference, global, a pose x,y,θ in m and rad, as "
            "in --start=-1.5,2,0.3, room=x,y,x,y,…, near=x,y,within, or a .toml file."
        )
    x, y, heading = pose("--start", given)
    return float(x), float(y), float(heading)


def _reference(whole: Log, played: Log, tolerance: float | None) -> str:
    """Say how many of the records played have a reference pose, and how good those between are."""
    known = played.referenced
    if not known.size:
        return ""
    within = tolerance_of(played, tolerance)
    between = 0 if played.interpolated is None else int(played.interpolated.sum())
    counts = [
        f"{known.size - between:,} of {len(played):,} records have a pose within "
        f"{1000 * within:.3g} ms of their own time"
    ]
    if between:
        counts.append(
            f"for {between:,} it is interpolated along the odometry, whose error is spread over "
            "the way between two poses"
        )
    if unknown := len(played) - known.size:
        counts.append(f"{unknown:,} without one do not count")
    said = f"Reference: {'; '.join(counts)}."
    off = interpolation_errors(whole) if between else None
    if off is None:
        return said
    size = metre(whole.unit)
    position, heading = (np.quantile(one, (0.5, 0.95)) for one in off)
    return (
        f"{said} Every second pose, left out and interpolated from its neighbours, is off by "
        f"{position[0] / size:.3f} m and {math.degrees(heading[0]):.1f}° (median), "
        f"{position[1] / size:.3f} m and {math.degrees(heading[1]):.1f}° (95 %): errors "
        "of that size may be the reference's."
    )


def interpolation_errors(log: Log) -> tuple[Floats, Floats] | None:
    """How far off every second reference pose is if it is interpolated between its neighbours.

    More than at the records between, as here the neighbours are twice as far apart.

    Returns:
        Lengths and angles, (k,) each; None if there are none.
    """
    at = log.referenced
    if log.interpolated is not None:
        at = at[~log.interpolated[at]]
    if log.reference is None or at.size < 3:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LogWarning)  # of few records: half of them are left out
        half = referenced(log, Trajectory(log.times[at[::2]], log.reference[at[::2]]))
    hidden = at[1:-1:2]
    assert half.reference is not None
    if not np.isfinite(half.reference[hidden]).any():
        return None
    off = absolute(log.reference[hidden], half.reference[hidden])
    return off.translation, off.rotation


def _assumed(part: str, given: str) -> dict[str, Any]:
    """Return "kind=…,name=number,…" as assumptions by dotted name."""
    found: dict[str, Any] = {}
    option, form = f"--{part}", "name=number, comma-separated"
    for name, value in _pairs(option, _listed(given), form):
        numbers = None if name == "kind" else _numbers(value)
        if numbers is None and name != "kind":
            raise InputError(f"{option} has '{name}={value}', but must be {form}.")
        found[f"{part}.{name}"] = value if numbers is None else numbers[0]
    return found


def _changes(given: str) -> dict[str, Any]:
    """Return "share=…,distance=…,kinds=removed+added,seed=…" as changes of a map's walls."""
    found: dict[str, Any] = {}
    for name, value in _pairs("--changed-walls", _listed(given), "name=value, comma-separated"):
        numbers = _numbers(value)
        known: Any = value if numbers is None else numbers[0]
        if name == "kinds":
            known = value.split("+")
        elif name == "seed" and isinstance(known, float) and known.is_integer():
            known = int(known)
        found[f"changed_walls.{name}"] = known
    return found


def _listed(given: str) -> list[str]:
    """Return the words of a comma-separated list, empty ones left out."""
    return [word for part in given.split(",") if (word := part.strip())]


def _pairs(
    option: str, words: Iterable[str], form: str, often: Collection[str] = ()
) -> Iterator[tuple[str, str]]:
    """Yield the name and the value of each "name=value".

    Args:
        option: that has the words.
        words: in their order.
        form: of one of them, for readers.
        often: names that may be given more than once.

    Raises:
        InputError: a word has another form, or another name is given twice.
    """
    seen: set[str] = set()
    for word in words:
        name, equals, value = map(str.strip, word.partition("="))
        if not (name and equals):
            raise InputError(f"{option} has {word!r}, but must be {form}.")
        if name in seen and name not in often:
            raise InputError(f"{option} gives {name} twice: give it once.")
        seen.add(name)
        yield name, value


def _numbers(text: str) -> list[float] | None:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        return None
