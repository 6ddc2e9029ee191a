"""Check a localizer, an agent or a scan model against named laws.

One line per law: ok, FAILED or skipped, with the reason. Exit code 3 if a law fails.
"""

import argparse
from contextlib import closing
from typing import TYPE_CHECKING

from benchmarks.console import doing

if TYPE_CHECKING:  # loaded when needed
    from collections.abc import Sequence

    from localizers.checks.laws import Law, Verdict

_BEFORE_ANY = ("answers in time", "makes a localizer", "answers with beliefs")


class LawsBrokenError(RuntimeError):
    """A localizer, an agent or a scan model breaks laws, which have been printed."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add(
        "name",
        metavar="NAME",
        help="a name (deqmcl list), package.module:NAME or path/to/file.py[:NAME]",
    )
    add(
        "--map",
        metavar="MAP.yaml",
        help="try it on this map, in m, instead of a small room of polygons",
    )
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument("--agent", action="store_true", help="NAME is of an agent")
    kinds.add_argument("--scan", action="store_true", help="NAME is of a scan model")
    add(
        "--scenario",
        metavar="NAME",
        help="where an agent drives (guided; with a goal, driving), or whose map and lidar a scan "
        "model is for (sharp; if it needs a map of cells, lost)",
    )
    add("--timeout", type=float, default=60.0, metavar="S", help="seconds allowed per law (60)")


def run(options: argparse.Namespace) -> str:
    """Run the command, printing each law as it is tried; return the last lines."""
    from deqmcl_gym.maps import GridMap
    from deqmcl_gym.validation import InputError
    from localizers.checks.laws import LAWS
    from localizers.checks.run import examined
    from localizers.checks.subject import robot_on
    from localizers.registry import LOCALIZER

    if options.agent or options.scan:
        if options.map is not None:
            raise InputError("--map is for localizers: with --agent or --scan give --scenario.")
        return _by_scenario(options)
    if options.scenario is not None:
        raise InputError(
            "--scenario is for agents and scan models: give --agent or --scan, or --map for a "
            "localizer."
        )
    name = LOCALIZER.complete(options.name)
    robot = None if options.map is None else robot_on(GridMap.load(options.map))
    with doing(f"loading {name}"):
        examination = examined(name, robot, timeout=options.timeout)
    with closing(examination):
        tried = []
        for law in LAWS:
            with doing(f"trying the law {law.name!r}"):
                tried.append(examination.verdict(law))
            if robot is None and tried[-1].status == "FAILED":
                _refuse_if_cells_are_needed(name, law, tried[-1].note, options.timeout)
            print(tried[-1], flush=True)
        _refuse_broken(tried)
        milliseconds = examination.milliseconds_per_step()
    skipped = sum(verdict.status == "skipped" for verdict in tried)
    return (
        f"time per step: {milliseconds:.3g} ms, the median of a short drive\n"
        f"{name} keeps all laws" + (f" ({skipped} skipped)." if skipped else ".")
    )


def _by_scenario(options: argparse.Namespace) -> str:
    """Check an agent or a scan model."""
    from benchmarks.checks import agent_laws, scan_laws

    kind, laws = ("agents", agent_laws) if options.agent else ("scan models", scan_laws)
    tried = []
    with doing(f"trying the laws of {kind} on {options.name}"):
        for verdict in laws.verdicts(options.name, options.scenario, timeout=options.timeout):
            print(verdict, flush=True)
            tried.append(verdict)
    _refuse_broken(tried)
    return f"{options.name} keeps all laws of {kind}."


def _refuse_broken(tried: "Sequence[Verdict]") -> None:
    failed = [verdict for verdict in tried if verdict.status == "FAILED"]
    if failed:
        words = f"{len(failed)} of {len(tried)} laws failed"
        named = ", ".join(repr(verdict.law) for verdict in failed)
        raise LawsBrokenError(f"{words}: {named}.") from failed[0].error


def _refuse_if_cells_are_needed(name: str, law: "Law", why: str, timeout: float) -> None:
    """Refuse a localizer that runs on a map of cells, but not in a room of polygons."""
    from deqmcl_gym.validation import InputError
    from localizers.checks.run import examined
    from localizers.checks.subject import robot_on_cells

    if law.name not in _BEFORE_ANY:
        return
    with (
        doing(f"trying {law.name!r} on a map of cells"),
        closing(examined(name, robot_on_cells(), timeout=timeout)) as on_cells,
    ):
        if on_cells.verdict(law).status != "FAILED":
            raise InputError(
                f"{name} does not run in the room of polygons in which laws are tried ({why}), but "
                "does on a map of cells: give one, as in --map MAP.yaml."
            )
