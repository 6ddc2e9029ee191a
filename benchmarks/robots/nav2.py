"""Nav2's AMCL parameters: of our ``amcl``, which has the same, and what others assume like it.

Names, defaults and meaning are those of docs.nav2.org, "AMCL". Files are read as by ros2/rcl
(parse.c) and ros2/rclcpp (parameter_map.cpp): of a key given twice, tables are joined and the later
value counts; "/*" is any part of a node's name, "/**" any number; all that fit apply in file order.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from inspect import signature
from pathlib import Path
from typing import Any

import yaml

from benchmarks.robots import Replay
from benchmarks.setup.priors import Gaussian
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.files import content_of, refusing, yaml_of
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.maps.clusters import Near
from deqmcl_gym.validation import InputError, boolean, number, one_of, pose, shown
from localizers import DifferentialMotion, OmniMotion, RobotModel, make
from localizers.methods.amcl import DIFFERENTIAL, OMNI, amcl
from localizers.models.nav2_motion import MotionModel, kind_of

_PARAMETERS = "ros__parameters"
_BOOLS = dict.fromkeys(("y", "yes", "true", "on"), True)
_BOOLS |= dict.fromkeys(("n", "no", "false", "off"), False)
_Nodes = dict[str, dict[str, Any]]
_OURS = ("robot", "selective_resampling", "field_cell")  # of ``amcl``; all others are Nav2's
_OF_LOGS = {"laser_max_range": 100.0, "laser_min_range": -1.0}  # are no parameters of ``amcl``
_ARGUMENTS = sorted(signature(amcl).parameters.items())
_DEFAULTS = {name: arg.default for name, arg in _ARGUMENTS if name not in _OURS} | _OF_LOGS
_RANGES: Mapping[str, Mapping[str, Any]] = {
    "pf_z": {"low": 0},
    "sigma_hit": {"low": 0, "above": True},
    "update_min_a": {"low": 0, "high": 6.2832},  # rad, a whole turn: more is in degrees
    "laser_max_range": {"finite": False},
}
_LASERS = ("likelihood_field", "likelihood_field_prob", "beam")
_ROBOTS = {DIFFERENTIAL: DIFFERENTIAL, OMNI: OMNI}
_ROBOTS |= {"differential": DIFFERENTIAL, "omnidirectional": OMNI}  # before Humble
_FINER = 4  # records to the least movement between two updates
_POSE = ("initial_pose.x", "initial_pose.y", "initial_pose.yaw")
_START = {"set_initial_pose": False, **dict.fromkeys((*_POSE, "initial_pose.z"), 0.0)}
_KNOWN = _DEFAULTS | _START
_TYPES = {float: "a double", int: "an integer", bool: "a bool"}
_ENV = re.compile(r"""\$\(env\s+\w+\s+(['"]?)([^()'"]*?)\1\s*\)""")  # with a default
_ROS = "of ROS, not of the filter"
_OF_ROS = (
    "always_reset_initial_pose", "base_frame_id", "first_map_only", "freespace_downsampling",
    "global_frame_id", "introspection_mode", "map_topic", "odom_frame_id", "random_seed",
    "save_pose_rate", "scan_topic", "tf_broadcast", "transform_tolerance",
    "use_sim_time", "service_introspection_mode", "qos_overrides", "bond_heartbeat_period",
    "bond_timeout", "autostart_node", "start_type_description_service",
    "initialize_at_saved_pose", "saved_pose_filepath", "allow_parameter_qos_overrides",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Amcl:
    """A robot's AMCL parameters, as our localizers, logs and scenarios take them. Lengths in m."""

    source: str  # where it was read
    file: Path
    params: Mapping[str, Any]  # of our ``amcl``
    reading: Mapping[str, float]  # bounds of the ranges that are measurements, if set: for logs
    motion: MotionModel  # what other localizers assume of the odometry
    # (distance, angle rad) between records, a quarter of ``update_min_*``: so updates come in time
    every: tuple[float, float]
    start: tuple[float, float, float] | None  # (x, y, θ) of the robot; None if it is not set
    unused: Mapping[str, str]  # what has no counterpart, with the reason
    notes: Sequence[str]  # of these, and of what ROS or Nav2 does otherwise, or is easily missed

    def differences(self, params: Mapping[str, Any], replay: Replay) -> list[str]:
        """How a replay with other parameters differs, in a sentence; empty if it does not."""
        world = replay.world
        distance, angle = spacing("every", world["every"], replay.log.unit)
        file, played = {**self.params}, {**self.params, **params}
        played["max_beams"] = min(played["max_beams"], world["max_beams"])
        played["update_min_d"] = max(played["update_min_d"], distance)
        played["update_min_a"] = max(played["update_min_a"], angle)
        for name in ("max_range", "min_range"):
            file[f"laser_{name}"] = self.reading.get(name, "the sensor's")
            played[f"laser_{name}"] = world.get(f"reading.{name}", "the sensor's")
        prior, first = replay.scenario.prior, replay.log[0].reference
        if self.start is not None:
            file["initial_pose"] = self.start
            played["initial_pose"] = replay.assumed.get("prior.mean", "another start")
            if type(prior) is Gaussian and prior.mean is None and first is not None:
                near = Near(prior.sd_position, prior.sd_heading)
                same = near([first], self.start, unit=replay.log.unit)[0]
                x, y, heading = first
                at = f"the reference's first pose ({x:z.2f}, {y:z.2f}, {heading:z.2f})"
                played["initial_pose"] = self.start if same else at
        changes = [f"{n} {file.get(n)} → {v}" for n, v in played.items() if v != file.get(n)]
        return [f"{self.source}: what is played differs in {', '.join(changes)}"] if changes else []

    @property
    def settings(self) -> dict[str, Any]:
        """What others assume, and which ranges are measurements, as settings of ``replay_of``."""
        motion = {"kind": kind_of(self.motion), **vars(self.motion)}
        settings = {f"assumed.motion.{name}": value for name, value in motion.items()}
        settings |= {f"world.reading.{name}": value for name, value in self.reading.items()}
        return settings | {"assumed.scan.sigma": self.params["sigma_hit"]}


def read_nav2(path: Path, node: str | None = None) -> Amcl:
    """Read a Nav2 file's parameters of a node, as "/robot1/amcl"; None is the only amcl in it."""
    _, nodes, twice = _nodes_of(path)
    name = _node_named(nodes, path, node)
    values = {n: v for pattern in _fitting(name, nodes) for n, v in nodes[pattern].items()}
    overridden = [n for n, value in nodes.get(name, {}).items() if values[n] != value]
    remarks = {"given twice, where rcl joins tables and takes the later value": twice}
    remarks |= {f"overridden by a wildcard that stands after {name}, as in rclcpp": overridden}
    room = PolygonMap(((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)), unit="m")
    try:
        file = _amcl(path, f"{path}, node {name}", values, remarks)
        lidar = Lidar(max_range=file.reading.get("max_range", 100.0))
        robot = RobotModel(floor_plan=room, lidar=lidar, motion=file.motion)
        make("amcl", robot, **file.params, field_cell=0.1)  # looks at them, in any room
        return file
    except InputError as error:
        raise InputError(f"{path}, node {name}: {error}") from None


def usual_params() -> dict[str, Any]:
    """Return Nav2's defaults of the parameters of ``amcl``."""
    return {name: value for name, value in _DEFAULTS.items() if name not in _OF_LOGS}


def nav2_document(
    params: Mapping[str, Any], path: Path | None = None, node: str | None = None
) -> dict[str, Any]:
    """Return a Nav2 parameter file, as of YAML, with parameters of ``amcl`` that are no defaults.

    The other content of the file at ``path`` is kept; ``node`` is as for ``read_nav2``.
    """
    for name in _OURS:
        if params.get(name, False) is not False:
            raise InputError(f"{name} is no parameter of Nav2's AMCL: leave it out.")
    for name in ("laser_model_type", "robot_model_type"):
        if params.get(name) == "robot":
            raise InputError(f"{name} is 'robot', which Nav2's AMCL does not have.")
    values = {n: _value(n, default, params) for n, default in usual_params().items()}
    if path is None:
        return {"amcl": {"ros__parameters": values}}
    document, nodes, _ = _nodes_of(path)
    name = _node_named(nodes, path, node)
    if _fitting(name, nodes)[-1] != name:  # what stands last is not overridden
        tops = {full: key for key in document for full, _ in _tables({key: document[key]})}
        inner = document.pop(key := tops.get(name, name), {})
        document[key] = inner if name in tops else {**inner, _PARAMETERS: {}}
    dict(_tables(document))[name].update(values)
    return document


def _amcl(file: Path, source: str, raw: Mapping[str, Any], remarks: dict[str, list[str]]) -> Amcl:
    filled = {n: _ENV.sub(r"\2", str(v)) for n, v in raw.items() if _ENV.search(str(v))}
    values = {**raw, **{n: _scalar(text) for n, text in filled.items()}}
    settings = {name: _value(name, default, values) for name, default in _DEFAULTS.items()}
    one_of("laser_model_type", settings["laser_model_type"], _LASERS)
    robot = one_of("robot_model_type", settings["robot_model_type"], _ROBOTS)
    settings["robot_model_type"] = _ROBOTS[robot]
    model = OmniMotion if _ROBOTS[robot] == OMNI else DifferentialMotion
    alphas = [f.name for f in fields(model) if f.name.startswith("alpha")]
    unused = dict.fromkeys(sorted({n.split(".")[0] for n in values} & {*_OF_ROS}), _ROS)
    strange = [n for n in values if n not in _KNOWN and n.split(".")[0] not in unused]
    unused |= dict.fromkeys(strange, "no parameter of Nav2's AMCL")
    unknown = [n for n in _START if "$(" in str(values.get(n))]
    unused |= dict.fromkeys(unknown, "a launch substitution: no start is taken")
    start = None
    if not unknown and _value("set_initial_pose", False, values):
        start = pose("initial_pose", [_value(name, 0.0, values) for name in _POSE])
        unread = [name for name in strange if name.startswith("initial_pose")]
        unused |= dict.fromkeys(unread, f"Nav2 starts at x, y and yaw of initial_pose, {start}")
    defaults = [f"{n} {shown(raw[n])}" for n in filled if n in _KNOWN and n not in unknown]
    remarks["launch substitutions, whose default is taken"] = defaults
    remarks["taken, but of types that Nav2 refuses"] = [
        f"{n} {shown(values[n])} (must be {_TYPES[type(default)]})"
        for n, default in _KNOWN.items()
        if n not in unknown and type(values.get(n, default)) is not type(default)
    ]
    wide = settings["update_min_a"] > math.pi
    remarks["above π, so that no turn is enough for an update"] = ["update_min_a"] * wide
    reasons = dict.fromkeys(reason for reason in unused.values() if reason != _ROS)
    idle = {why: [name for name, reason in unused.items() if reason == why] for why in reasons}
    notes = [f"not used: {', '.join(names)} ({why})" for why, names in idle.items()]
    notes += [f"{why}: {', '.join(names)}" for why, names in remarks.items() if names]
    # not above 0: what the sensor says, as in Nav2
    bounds = {"max_range": settings["laser_max_range"], "min_range": settings["laser_min_range"]}
    return Amcl(
        source=source,
        file=file,
        params={name: value for name, value in settings.items() if name not in _OF_LOGS},
        reading={name: value for name, value in bounds.items() if 0 < value < math.inf},
        motion=model(**{name: settings[name] for name in alphas}),
        every=(settings["update_min_d"] / _FINER, settings["update_min_a"] / _FINER),
        start=start,
        unused=unused,
        notes=[f"{source}: {note}" for note in notes],
    )


def _value(name: str, default: Any, values: Mapping[str, Any]) -> Any:
    """Return a parameter's value, of its default's type, or the default."""
    value = values.get(name, default)
    if "$(" in str(value):
        raise InputError(
            f"{name} is {shown(value)}, a launch substitution, but must be a value: give the file "
            "that `ros2 param dump` writes of the running node."
        )
    if isinstance(default, str):
        return value
    value = _scalar(value) if isinstance(value, str) else value
    if isinstance(default, bool):
        return boolean(name, value)
    read = type(default)(number(name, value, **_RANGES.get(name, {})))
    if read != value:
        raise InputError(f"{name} is {value!r}, but must be an integer.")
    return read


def _nodes_of(path: Path) -> tuple[dict[str, Any], _Nodes, list[str]]:
    """Return a file's tables, its parameters by node and dotted name, and keys given twice."""
    twice: list[str] = []
    nodes: _Nodes = {}
    with refusing(path):
        tree = yaml_of(content_of(path), lambda root: _built(root, "", {}, twice))
    tops = tree.items() if isinstance(tree, dict) else ()
    document = {name: table for name, table in tops if isinstance(table, dict)}
    for name, table in _tables(document):
        nodes.setdefault(name, {}).update(_dotted(table))
    return document, nodes, list(dict.fromkeys(twice))


def _tables(document: Mapping[str, Any], at: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters of all nodes by full name, namespaces nested or written out."""
    for name, inner in document.items():
        if isinstance(inner, dict) and at and name == _PARAMETERS:
            yield at, inner
        elif isinstance(inner, dict):
            yield from _tables(inner, f"{at.rstrip('/')}/{name.strip('/')}")


def _fitting(name: str, patterns: Iterable[str]) -> list[str]:
    """Return the names and wildcards that fit a node, in order."""
    regexes = ((p, re.escape(p).replace(r"/\*\*", "(/[^/]+)*")) for p in patterns)
    return [p for p, regex in regexes if re.fullmatch(regex.replace(r"/\*", "/[^/]+"), name)]


def _node_named(nodes: _Nodes, path: Path, asked: str | None) -> str:
    """Return the node asked for, or the only amcl, or the shortest that most wildcards fit."""
    filters = [name for name in nodes if name.endswith("/amcl") and "*" not in name]
    if asked is not None:
        name = f"/{asked.strip('/')}"
        likely = name.endswith("/amcl") or not filters  # a typing error would fit "/**", too
        return name if likely and _fitting(name, nodes) else one_of(f"node of {path}", name, nodes)
    if not filters:
        most: dict[str, int] = {}
        for pattern in nodes:
            at = pattern.replace("/**", "")
            names = at, f"{at.removesuffix('/*')}/amcl"
            shortest = [n for n in names if n.endswith("/amcl") and _fitting(n, [pattern])][:1]
            most |= {name: len(_fitting(name, nodes)) for name in shortest}
        filters = [name for name, count in most.items() if count == max(most.values())]
    if len(filters) == 1:
        return filters[0]
    listed = ", ".join(nodes) or "none at all: is it of ROS 1?"
    has = f"{len(filters)} nodes of AMCL, {', '.join(filters)}"
    has = has if filters else f"no node amcl with {_PARAMETERS} (its nodes: {listed})"
    raise InputError(f"{path} has {has}: choose one by --node, or give Nav2's parameter file.")


def _scalar(text: str) -> Any:
    """Return the value of a plain scalar, of the type that rcl gives it; None if it is empty."""
    if text.lower() in _BOOLS:
        return _BOOLS[text.lower()]
    if "_" not in text:
        with suppress(ValueError):
            return int(text, 0)
        with suppress(ValueError):
            return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text or None


def _built(node: Any, at: str, before: Any, twice: list[str]) -> Any:
    """Return a YAML node's value, joined to what stands before it under the same name."""
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style in ("'", '"') else _scalar(node.value)
    if not isinstance(node, yaml.MappingNode):
        return [_built(item, at, {}, twice) for item in node.value] if node else None
    joined = before if isinstance(before, dict) else {}
    for key, value in node.value:
        name = str(key.value)
        path = f"{at}.{name}" if at else name
        if name in joined and not (at and isinstance(value, yaml.MappingNode)):
            twice.append(path)
        joined[name] = _built(value, path, joined.get(name), twice)
    return joined


def _dotted(table: Mapping[str, Any], at: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        inner = isinstance(value, dict)
        yield from _dotted(value, f"{at}{name}.") if inner else [(f"{at}{name}", value)]
