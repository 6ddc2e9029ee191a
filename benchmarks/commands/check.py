"""Check a localizer, an agent or a scan model against named laws.

One line per law: ok, FAILED or skipped, with the reason. Exit code 3 if a law fails.
"""

import argparse
from typing import TYPE_CHECKING, Any

from benchmarks.console import doing

if TYPE_CHECKING:  # loaded when needed
    from localizers.checks import Report


class LawsBrokenError(RuntimeError):
    """A localizer, an agent or a scan model breaks laws, which have been printed."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("name", metavar="NAME", help="a name (deqmcl list), package.module:NAME or "
        "path/to/file.py[:NAME]")  # fmt: skip
    add("--map", metavar="MAP.yaml", help="try it on this map, in m, instead of a small room of "
        "polygons")  # fmt: skip
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument("--agent", action="store_true", help="NAME is of an agent")
    kinds.add_argument("--scan", action="store_true", help="NAME is of a scan model")
    add("--scenario", metavar="NAME", help="where an agent drives (guided; with a goal, driving), "
        "or whose map and lidar a scan model is for (sharp; if it needs a map of cells, lost)"
        )  # fmt: skip


def run(options: argparse.Namespace) -> str:
    """Run the command, printing each law as it is tried; return the last line."""
    from localizers.checks import law_name

    with doing(f"loading {options.name}"):
        kind, report = _report(options)
    for law in report.laws:
        with doing(f"trying the law {law_name(law)!r}"):
            verdict = report.verdict(law)
        print(verdict, flush=True)
    verdicts, failed = report.verdicts, report.failed
    if failed:
        named = ", ".join(repr(verdict.law) for verdict in failed)
        at_once = kind == "localizers" and options.map is None and failed[0] in verdicts[:2]
        hint = " If it is for maps of cells alone, give one: --map MAP.yaml." * at_once
        raise LawsBrokenError(
            f"{len(failed)} of {len(verdicts)} laws failed: {named}.{hint}"
        ) from failed[0].error
    skipped = sum(verdict.status == "skipped" for verdict in verdicts)
    return f"{options.name} keeps all laws of {kind}" + (
        f" ({skipped} skipped)." if skipped else "."
    )


def _report(options: argparse.Namespace) -> "tuple[str, Report[Any]]":
    from deqmcl_gym.maps import GridMap
    from deqmcl_gym.validation import InputError
    from localizers.checks import check_localizer
    from localizers.checks.subject import robot_on

    if options.agent or options.scan:
        from benchmarks import checks

        if options.map is not None:
            raise InputError("--map is for localizers: with --agent or --scan give --scenario.")
        check = checks.check_agent if options.agent else checks.check_scan
        return "agents" if options.agent else "scan models", check(options.name, options.scenario)
    if options.scenario is not None:
        raise InputError(
            "--scenario is for agents and scan models: give --agent or --scan, or --map for a "
            "localizer."
        )
    robot = None if options.map is None else robot_on(GridMap.load(options.map))
    return "localizers", check_localizer(options.name, robot)
