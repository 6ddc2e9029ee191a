"""What is replayed: a log on a map, and what the localizers assume."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.replay.errors import interpolation_errors
from benchmarks.replay.nav2 import Amcl
from benchmarks.setup.log_scenario import check_inside
from benchmarks.setup.motion_noise import motion_noise
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Log
from deqmcl_gym.maps.map import PIXELS, pixel
from deqmcl_gym.validation import InputError, number, one_of, pose
from localizers import (
    GaussianPrior,
    GaussianUniform,
    Prior,
    RobotModel,
    UniformPrior,
)
from localizers.models.beams import BEAM_MODELS, METRE_SIGMA, BeamDensity
from localizers.models.nav2_motion import MOTION_MODELS, MotionModel, kind_of, unknown_motion

EVERY = "0.2m,5deg"
START = 0.2, 0.1  # m and rad: standard deviations of a start that is known


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A log on a map.

    Attributes:
        log: the records that are played.
        map: path of its yaml.
        unknown: what the map's unknown cells count as; see ``GridMap``.
        start: (x, y, θ) about which the robot's first pose is known; None: nothing is.
        motion, scan: the noise that the localizers assume.
        noise: where that of the motion is from.
        reference: where the true poses are from, in words; "" without any.
        radius: of the robot, in the log's unit.
        calibration: how the power of the scan model was fitted, in words; "" if it was not.
        judged: first record by which beliefs are judged: it was not fitted on.
    """

    log: Log
    map: str
    unknown: str
    start: tuple[float, float, float] | None
    motion: MotionModel
    scan: BeamDensity
    noise: str
    reference: str
    radius: float
    calibration: str = ""
    judged: int = 0

    def env(self) -> LogEnv:
        """Return the log as an environment."""
        return LogEnv(log=self.log, map=self.map, unknown=self.unknown)

    @property
    def metre(self) -> float:
        """A metre in the log's unit."""
        return metre(self.log)


@dataclass(frozen=True, kw_only=True)
class Told:
    """What a user says about a replay; None: not given.

    Attributes:
        start: "reference", "global" or "x,y,θ" of the robot; None is the reference if there is one.
        every, max_beams: see ``LogEnv``; None is ``EVERY``, and 60.
        motion: "kind=differential,alpha1=…"; None estimates it from the reference if there is one.
        scan: values of a beam model, as in "kind=beam-model,sigma=0.2,power=0.5".
        radius: of the robot, m; None is 0.16 m.
        otherwise: the start of a log without a reference, if none is said.
        unknown: what the map's unknown cells count as: "obstacle", "transparent" or "free".
    """

    start: str | None = None
    every: str | tuple[float, float] | None = None
    max_beams: int | None = None
    motion: str | None = None
    scan: str | None = None
    radius: float | None = None
    otherwise: str | None = None
    unknown: str = "obstacle"

    @property
    def power(self) -> bool:
        """Whether the power of the scan model is given."""
        return any(name == "power" for name, _ in _pairs("--scan", self.scan or ""))

    def or_nav2(self, nav2: Amcl | None) -> "Told":
        """Return this with what is not said from Nav2's parameters."""
        if nav2 is None:
            return self
        words = {"kind": kind_of(nav2.motion), **vars(nav2.motion)}
        motion = ",".join(f"{name}={value}" for name, value in words.items())
        scan = f"sigma={nav2.sigma!r}"
        return replace(
            self,
            every=nav2.every if self.every is None else self.every,
            max_beams=nav2.max_beams if self.max_beams is None else self.max_beams,
            motion=motion if self.motion is None else self.motion,
            scan=scan if self.scan is None else f"{scan},{self.scan}",
            otherwise=None if nav2.start is None else ",".join(map(repr, nav2.start)),
        )


def setting_of(log: Log, floor_plan: str | Path, told: Told) -> Setting:
    """Return what is to be replayed.

    Args:
        log: read from a file, with its reference if there is one.
        floor_plan: path of the map's yaml.
        told: what a user says of it.

    Raises:
        InputError: something of it is refused.
    """
    if told.radius is not None:
        number("--radius", told.radius, low=0)
    start = told.start
    if start is None:
        start = "reference" if log.reference is not None else told.otherwise
    if start is None:
        raise InputError(
            f"{log.source} has no reference: give --reference, --start x,y,θ or --start global."
        )
    if start == "reference":
        if not log.referenced.size:
            raise InputError(f"--start is reference, but {log.source} has none: give --reference.")
        log = log.segment(int(log.referenced[0]))
    env = LogEnv(
        log=log,
        map=floor_plan,
        unknown=told.unknown,
        every=EVERY if told.every is None else told.every,
        max_beams=60 if told.max_beams is None else told.max_beams,
    )
    check_inside(env.log, env.floor_plan)
    noise, origin = _motion(env.log, told.motion)
    return Setting(
        log=env.log,
        map=str(floor_plan),
        unknown=told.unknown,
        start=_start(start, env),
        motion=noise,
        scan=_scan(told.scan, metre(log)),
        noise=origin,
        reference=_reference(log, env.log),
        radius=env.radius if told.radius is None else told.radius * metre(log),
    )


def reading_of(words: Sequence[str]) -> dict[str, Any]:
    """Return NAME=VALUE words as arguments of ``logs.read``.

    Raises:
        InputError: a word of another form.
    """
    found: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise InputError(f"--read is {word!r}, but must be NAME=VALUE, as scan_topic=/front.")
        if name.strip() == "scanner":
            raise InputError(
                "--read takes no scanner: write it into the file, as "
                '# {"angles": [-1.57, 0, 1.57], "max_range": 8} in the first line of a CSV.'
            )
        numbers = None if name.strip().endswith(("_topic", "_frame")) else _numbers(value)
        one = numbers[0] if numbers is not None and len(numbers) == 1 else numbers
        found[name.strip()] = value.strip() if one is None else one
    return found


def robot_of(setting: Setting, env: LogEnv) -> tuple[RobotModel, Prior]:
    """Return what localizers are made for, and p(x_0)."""
    robot = RobotModel(
        floor_plan=env.floor_plan,
        lidar=env.lidar,
        radius=setting.radius,
        motion=setting.motion,
        scan=setting.scan,
    )
    if setting.start is None:
        return robot, UniformPrior(floor_plan=env.floor_plan, radius=robot.radius)
    position, heading = START
    prior = GaussianPrior(
        mean=setting.start, sd_position=position * setting.metre, sd_heading=heading
    )
    return robot, prior


def metre(log: Log) -> float:
    """Return a metre in the log's unit."""
    return pixel(log.unit) / PIXELS["m"]


def _start(start: str, env: LogEnv) -> tuple[float, float, float] | None:
    if start == "global":
        return None
    if start == "reference":
        first = env.record.reference if env.reset() else None
        assert first is not None
        return first
    given = _numbers(start)
    if given is None or len(given) != 3:
        raise InputError(
            f"--start is {start!r}, but must be reference, global, or a pose x,y,θ in m and rad, "
            "as in --start=-1.5,2,0.3."
        )
    at = np.array([pose("--start", given)])
    if not env.floor_plan.free(at)[0]:
        raise InputError(
            f"--start is ({given[0]:g}, {given[1]:g}), but that is no free space on the map: give "
            "a pose where the robot can be."
        )
    x, y, heading = at[0].tolist()
    return x, y, heading


def _reference(whole: Log, played: Log) -> str:
    """Say how many of the records played have a reference pose, and how good those between are."""
    known = played.referenced
    if not known.size:
        return ""
    between = 0 if played.interpolated is None else int(played.interpolated.sum())
    counts = [f"{known.size - between:,} of {len(played):,} records have a pose of their own time"]
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
    position, heading = (np.quantile(one, (0.5, 0.95)) for one in off)
    return (
        f"{said} Every second pose, left out and interpolated from its neighbours, is off by "
        f"{position[0] / metre(whole):.3f} m and {math.degrees(heading[0]):.1f}° (median), "
        f"{position[1] / metre(whole):.3f} m and {math.degrees(heading[1]):.1f}° (95 %): errors "
        "of that size may be the reference's."
    )


def _motion(log: Log, given: str | None) -> tuple[MotionModel, str]:
    """Return the motion's noise, and where it is from."""
    words = dict(_pairs("--motion", given or ""))
    kind = one_of("motion model", words.pop("kind", "differential"), MOTION_MODELS)
    noise, origin = unknown_motion(kind, log.unit), "assumed, as there is no reference"
    names = [field.name for field in fields(noise)]
    keys = _keys("--motion", words, names)
    if set(names) - {"still"} <= keys.keys():
        return replace(noise, **keys), "given"
    if log.reference is not None:
        noise = motion_noise(log, kind)
        origin = "of the log's odometry against its reference, at least half of Nav2's defaults"
    return replace(noise, **keys), f"{', '.join(keys)} given; the rest {origin}" if keys else origin


def _scan(given: str | None, metre: float) -> BeamDensity:
    words = dict(_pairs("--scan", given or ""))
    kind = BEAM_MODELS[one_of("beam model", words.pop("kind", "gaussian-uniform"), BEAM_MODELS)]
    keys = _keys("--scan", words, [field.name for field in fields(kind)])
    lengths: Mapping[str, float] = {"sigma": METRE_SIGMA * metre}
    if kind is not GaussianUniform and "decay" in {field.name for field in fields(kind)}:
        lengths = {**lengths, "decay": 0.5 / metre}
    return kind(**{**lengths, **keys})


def _keys(what: str, given: str | Mapping[str, str], names: list[str]) -> dict[str, Any]:
    """Return "name=number,…" as numbers by name."""
    found: dict[str, Any] = {}
    for name, word in _pairs(what, given) if isinstance(given, str) else given.items():
        one_of(f"name in {what}", name, names)
        values = _numbers(word)
        if values is None or len(values) != 1:
            raise InputError(f"{what} has {name}={word}, but {name} must be a number.")
        found[name] = values[0]
    return found


def _pairs(what: str, given: str) -> list[tuple[str, str]]:
    pairs = [tuple(map(str.strip, part.split("=", 1))) for part in given.split(",") if part.strip()]
    if any(len(pair) != 2 for pair in pairs):
        raise InputError(f"{what} is {given!r}, but must be name=number, comma-separated.")
    return pairs  # type: ignore[return-value]


def _numbers(text: str) -> list[float] | None:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        return None
