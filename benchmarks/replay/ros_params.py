"""A parameter file of ROS 2: its nodes, wildcards and values, as rcl and rclcpp read them.

Of ros2/rcl, rcl_yaml_param_parser/src/parse.c: types of plain scalars; of a key given twice, tables
are joined and the later value counts. Of ros2/rclcpp, rclcpp/src/rclcpp/parameter_map.cpp: "/*" in
the name of a node is any part, "/**" any number of them, and all that fit are applied in the order
in which they first stand in the file, so that a wildcard overrides what stands before it.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from deqmcl_gym.files import UnreadableError, content_of, yaml_of
from deqmcl_gym.validation import InputError, one_of

_OWN = "ros__parameters"
_BOOLS = dict.fromkeys(("y", "yes", "true", "on"), True)
_BOOLS |= dict.fromkeys(("n", "no", "false", "off"), False)
_Nodes = dict[str, dict[str, Any]]


def read(path: Path) -> tuple[dict[str, Any], _Nodes, list[str]]:
    """Return a file's tables, its parameters by node and dotted name, and keys given twice."""
    twice: list[str] = []
    nodes: _Nodes = {}
    try:
        found = yaml_of(content_of(path), lambda root: _built(root, "", {}, twice))
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: give Nav2's parameter file.") from None
    except UnreadableError as error:
        raise InputError(f"{path} {error}: give another file.") from None
    tops = found.items() if isinstance(found, dict) else ()
    document = {name: table for name, table in tops if isinstance(table, dict)}
    for name, table in tables(document):
        nodes.setdefault(name, {}).update(_dotted(table))
    return document, nodes, list(dict.fromkeys(twice))


def tables(document: Mapping[str, Any], at: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters of all nodes by full name, namespaces nested or written out."""
    for name, inner in document.items():
        if isinstance(inner, dict) and at and name == _OWN:
            yield at, inner
        elif isinstance(inner, dict):
            yield from tables(inner, f"{at.rstrip('/')}/{name.strip('/')}")


def fitting(name: str, patterns: Iterable[str]) -> list[str]:
    """Return the names and wildcards that fit a node, in order."""
    parts, found = name.split("/")[1:], []
    for pattern in patterns:
        ends = {0}  # how many parts fit so far
        for part in pattern.split("/")[1:]:
            if part == "**":
                ends = {end for end in range(len(parts) + 1) if ends and end >= min(ends)}
            else:
                ends = {end + 1 for end in ends if part in ("*", *parts[end : end + 1])}
        found += [pattern] if len(parts) in ends else []
    return found


def node_named(last: str, nodes: _Nodes, path: Path, asked: str | None) -> str:
    """Return the node asked for, or the only one of this name, or that which most wildcards fit."""
    found = [name for name in nodes if name.endswith(f"/{last}") and "*" not in name]
    if asked is not None:
        name = f"/{asked.strip('/')}"
        likely = name.endswith(f"/{last}") or not found  # a typing error would fit "/**", too
        return name if likely and fitting(name, nodes) else one_of(f"node of {path}", name, nodes)
    if not found:
        most = {name: len(fitting(name, nodes)) for p in nodes for name in _shortest(p, last)}
        found = [name for name, count in most.items() if count == max(most.values())]
    if len(found) == 1:
        return found[0]
    there = ", ".join(nodes) or "none at all: is it of ROS 1?"
    has = f"{len(found)} nodes of AMCL, {', '.join(found)}"
    has = has if found else f"no node {last} with {_OWN} (its nodes: {there})"
    raise InputError(f"{path} has {has}: choose one by --node, or give Nav2's parameter file.")


def _shortest(pattern: str, last: str) -> list[str]:
    """Return the shortest name of a node "/…/last" that fits a wildcard, if any does."""
    at = pattern.replace("/**", "")
    names = at, f"{at.removesuffix('/*')}/{last}"
    return [n for n in names if n.endswith(f"/{last}") and fitting(n, [pattern])][:1]


def scalar(text: str) -> Any:
    """Return the value of a plain scalar, of the type that rcl gives it; None if it is empty."""
    if text.lower() in _BOOLS:
        return _BOOLS[text.lower()]
    if "_" not in text:
        with suppress(ValueError):
            return int(text, 0)
        with suppress(ValueError):
            return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text or None


def _built(node: Any, at: str, found: Any, twice: list[str]) -> Any:
    """Return a YAML node's value, joined to what stands before it under the same name."""
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style in ("'", '"') else scalar(node.value)
    if not isinstance(node, yaml.MappingNode):
        return [_built(one, at, {}, twice) for one in node.value] if node else None
    joined = found if isinstance(found, dict) else {}
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
