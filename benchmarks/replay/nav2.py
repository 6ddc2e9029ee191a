"""Nav2's AMCL parameters: of our ``amcl``, which has the same, and what others assume like it.

Names, defaults and meaning are those of docs.nav2.org, "AMCL".
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from inspect import signature
from pathlib import Path
from typing import Any

from deqmcl_gym.files import UnreadableError, as_number, content_of, yaml_of
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError, boolean, number, one_of, pose
from localizers import DifferentialMotion, GaussianUniform, OmniMotion, RobotModel, make
from localizers.methods.amcl import DIFFERENTIAL, OMNI, amcl
from localizers.models.nav2_motion import MotionModel, kind_of

_OURS = ("robot", "selective_resampling", "field_cell")  # of ``amcl``; all others are Nav2's
_OF_LOGS = {"laser_max_range": 100.0, "laser_min_range": -1.0}  # are no parameters of ``amcl``
_TAKEN = sorted(signature(amcl).parameters.items())
_DEFAULTS = {name: own.default for name, own in _TAKEN if name not in _OURS} | _OF_LOGS
_RANGES: Mapping[str, Mapping[str, Any]] = {
    **{name: {"low": 0} for name in ("pf_z", "alpha1", "alpha2", "alpha3")},
    "sigma_hit": {"low": 0, "above": True},
    "update_min_a": {"low": 0, "high": round(math.pi, 6)},  # rad: no turn is larger
}
_LASERS = ("likelihood_field", "likelihood_field_prob", "beam")
_ROBOTS = {DIFFERENTIAL: DIFFERENTIAL, OMNI: OMNI}
_ROBOTS |= {"differential": DIFFERENTIAL, "omnidirectional": OMNI}  # before Humble
_FINER = 4  # records to the least movement between two updates
_START = ("set_initial_pose", "initial_pose")
_POSE = "initial_pose."
_ROS = "of ROS, not of the filter"
_OF_ROS = (
    "always_reset_initial_pose", "base_frame_id", "first_map_only", "freespace_downsampling",
    "global_frame_id", "introspection_mode", "map_topic", "odom_frame_id", "random_seed",
    "save_pose_rate", "scan_topic", "tf_broadcast", "transform_tolerance",
    "use_sim_time", "service_introspection_mode", "qos_overrides", "bond_heartbeat_period",
    "bond_timeout", "autostart_node", "start_type_description_service",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Amcl:
    """What a robot's AMCL is told, as our localizers, logs and scenarios take it. Lengths in m.

    Attributes:
        source: where it was read.
        params: of our ``amcl``.
        reading: bounds of the ranges that are measurements, where they are given: of logs.
        motion: what other localizers assume of the odometry.
        sigma: of a beam, which they assume.
        every: (distance, angle rad) between two records, a quarter of ``update_min_*``, so that
            ``amcl`` updates when the robot has moved as far, and not much later.
        max_beams: of a scan.
        start: (x, y, θ) of the robot; None if it is not set.
        unused: what has no counterpart, with the reason.
    """

    source: str
    params: Mapping[str, Any]
    reading: Mapping[str, float]
    motion: MotionModel
    sigma: float
    every: tuple[float, float]
    max_beams: int
    start: tuple[float, float, float] | None
    unused: Mapping[str, str]

    @property
    def notes(self) -> list[str]:
        """What of the filter is not as AMCL has it, in a sentence; nothing if all is."""
        left = [name for name, why in self.unused.items() if why != _ROS]
        return [f"{self.source}: not used: {', '.join(left)}"] if left else []

    @property
    def options(self) -> dict[str, Any]:
        """What they say of a replay: see ``replay_of``."""
        words = {"kind": kind_of(self.motion), **vars(self.motion)}
        return {
            "every": self.every,
            "max_beams": self.max_beams,
            "motion": ",".join(f"{name}={value}" for name, value in words.items()),
            "scan": f"sigma={self.sigma!r}",
            "otherwise": None if self.start is None else ",".join(map(repr, self.start)),
        }

    @property
    def toml(self) -> str:
        """A sweep file without its log."""
        distance, angle = self.every
        motion = {"kind": kind_of(self.motion), **vars(self.motion)}
        at = [] if self.start is None else [self.start]
        lines = [
            _comment(self.source),
            *(_comment(f"not used: {name}: {why}") for name, why in self.unused.items()),
            *(f"# initial_pose: deqmcl replay --start={x},{y},{heading}" for x, y, heading in at),
            'scenario = "log"',
            'localizers = ["amcl"]',
            "",
            "[world]",
            '# log = "robot.log.gz"',
            '# map = "map.yaml"',
            '# reference = "robot.tum"',
            f'every = "{distance:g}m,{angle:g}rad"',
            f"max_beams = {self.max_beams}",
            *(f"reading.{name} = {value}" for name, value in self.reading.items()),
            "",
            "[assumed]",
            f"scan.sigma = {self.sigma}",
            *(f"motion.{name} = {json.dumps(value)}" for name, value in motion.items()),
            "",
            "[params]",
            *(f"{name} = {json.dumps(value)}" for name, value in self.params.items()),
        ]
        return "\n".join(lines)


def _comment(words: str) -> str:
    return "# " + "".join(
        word if word.isprintable() else "\N{REPLACEMENT CHARACTER}" for word in words
    )


def read_nav2(path: Path, node: str | None = None) -> Amcl:
    """Read the AMCL parameters of a Nav2 parameter file.

    Args:
        path: of the yaml.
        node: whose parameters, as "/robot1/amcl"; None is the only amcl in it.

    Raises:
        InputError: it cannot be read, has no such node or several, or a bad value.
    """
    nodes = dict(_nodes(_document(path), ""))
    shared = nodes.pop("/**", {})
    name = _chosen(path, nodes, node)
    given = {**shared, **nodes[name]}
    try:
        return _amcl(f"{path}, node {name}", given)
    except InputError as error:
        raise InputError(f"{path}, node {name}: {error}") from None


def usual_params() -> dict[str, Any]:
    """Return Nav2's defaults of the parameters of ``amcl``."""
    return {name: value for name, value in _DEFAULTS.items() if name not in _OF_LOGS}


def nav2_document(
    params: Mapping[str, Any], path: Path | None = None, node: str | None = None
) -> dict[str, Any]:
    """Return a Nav2 parameter file, as of YAML, with these parameters of ``amcl``.

    Args:
        params: what is not Nav2's default.
        path, node: a file whose other content is kept, as for ``read_nav2``; None: there is none.

    Raises:
        InputError: Nav2 has no such parameter, or no such value.
    """
    for name in _OURS:
        if params.get(name, False) is not False:
            raise InputError(f"{name} is no parameter of Nav2's AMCL: leave it out.")
    for name in ("laser_model_type", "robot_model_type"):
        if params.get(name) == "robot":
            raise InputError(f"{name} is 'robot', which Nav2's AMCL does not have.")
    told = {n: _value(n, default, params) for n, default in usual_params().items()}
    if path is None:
        return {"amcl": {"ros__parameters": told}}
    document = dict(_document(path))
    name = _chosen(path, {n: v for n, v in _nodes(document, "") if n != "/**"}, node)
    own = dict(_nodes(document, ""))[name]
    assert isinstance(own, dict)
    own |= told
    return document


def _amcl(source: str, given: Mapping[str, Any]) -> Amcl:
    said = {name: _value(name, default, given) for name, default in _DEFAULTS.items()}
    one_of("laser_model_type", said["laser_model_type"], _LASERS)
    robot = one_of("robot_model_type", said["robot_model_type"], _ROBOTS)
    said["robot_model_type"] = _ROBOTS[robot]
    model = OmniMotion if _ROBOTS[robot] == OMNI else DifferentialMotion
    alphas = [own.name for own in fields(model) if own.name.startswith("alpha")]
    unused = {name: _ROS for name in sorted(_OF_ROS) if name in given}
    known = {*_DEFAULTS, *_OF_ROS, *_START}
    strange = [name for name in given if name.split(".")[0] not in known]
    unused |= dict.fromkeys(strange, "no parameter of Nav2's AMCL")
    # not above 0: what the sensor says, as in Nav2
    bounds = {"max_range": said["laser_max_range"], "min_range": said["laser_min_range"]}
    found = Amcl(
        source=source,
        params={name: value for name, value in said.items() if name not in _OF_LOGS},
        reading={name: value for name, value in bounds.items() if value > 0},
        motion=model(**{name: said[name] for name in alphas}),
        sigma=said["sigma_hit"],
        every=(said["update_min_d"] / _FINER, said["update_min_a"] / _FINER),
        max_beams=said["max_beams"],
        start=_start(given),
        unused=unused,
    )
    _check(found)
    return found


def _value(name: str, default: Any, given: Mapping[str, Any]) -> Any:
    """Return what is given for a parameter, of its default's type, or the default."""
    value = given.get(name, default)
    if isinstance(default, str):
        return value
    if isinstance(default, bool):
        return boolean(name, value)
    value = as_number(value)
    read = type(default)(number(name, value, **_RANGES.get(name, {})))
    if read != value:
        raise InputError(f"{name} is {value!r}, but must be an integer.")
    return read


def _check(found: Amcl) -> None:
    """Let ``amcl`` look at its parameters, in any room."""
    room = PolygonMap(((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)), unit="m")
    robot = RobotModel(
        floor_plan=room,
        lidar=Lidar(max_range=found.reading.get("max_range", 100.0)),
        motion=found.motion,
        scan=GaussianUniform(sigma=found.sigma),
    )
    make("amcl", robot, **found.params, field_cell=0.1)


def _start(given: Mapping[str, Any]) -> tuple[float, float, float] | None:
    if not boolean("set_initial_pose", given.get("set_initial_pose", False)):
        return None
    at = given.get("initial_pose", {})
    if not isinstance(at, Mapping):
        raise InputError(f"initial_pose is {at!r}, but must be a table with x, y, z and yaw.")
    dotted = {n.removeprefix(_POSE): v for n, v in given.items() if n.startswith(_POSE)}
    given = {**at, **dotted}
    for name in given:
        one_of("name in initial_pose", name, ("x", "y", "z", "yaw"))
    values = [as_number(given.get(name, 0.0)) for name in ("x", "y", "yaw")]
    return pose("initial_pose", values)


def _document(path: Path) -> Mapping[str, Any]:
    try:
        found = yaml_of(content_of(path))
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: give Nav2's parameter file.") from None
    except UnreadableError as error:
        raise InputError(f"{path} {error}: give another file.") from None
    if not isinstance(found, Mapping):
        raise InputError(f"{path} has no nodes, but must be Nav2's parameter file.")
    return found


def _nodes(table: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the parameters of all nodes by full name, namespaces nested or written out."""
    for name, inner in table.items():
        if isinstance(inner, Mapping):
            at = f"{prefix}/{str(name).strip('/')}"
            own = inner.get("ros__parameters")
            if isinstance(own, Mapping):
                yield at, own
            yield from _nodes({k: v for k, v in inner.items() if k != "ros__parameters"}, at)


def _chosen(path: Path, nodes: Mapping[str, Any], asked: str | None) -> str:
    if asked is not None:
        return one_of(f"node of {path}", f"/{asked.strip('/')}", nodes)
    fitting = [name for name in nodes if name.rpartition("/")[2] == "amcl"]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(
            f"{path} has {len(fitting)} nodes of AMCL, {', '.join(fitting)}: choose one by --node."
        )
    there = ", ".join(nodes) or "none"
    raise InputError(
        f"{path} has no node amcl with ros__parameters (its nodes: {there}): give Nav2's parameter "
        "file, or choose a node by --node."
    )
