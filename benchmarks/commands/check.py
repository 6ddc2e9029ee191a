"""Check a localizer, an agent or a scan model against named laws.

One line per law: ok, FAILED or skipped, with the reason. Exit code 3 if a law fails.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from traceback import format_exception
from typing import TYPE_CHECKING, Any

from benchmarks.console import doing

if TYPE_CHECKING:  # loaded when needed
    from localizers.checks import LawVerdict, Report


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
    add("--timeout", type=float, default=60.0, metavar="S", help="seconds allowed per law (60)")


def run(options: argparse.Namespace) -> str:
    """Run the command, printing each law as it is tried; return the last line."""
    from benchmarks.execution import prepare
    from benchmarks.execution.processes import Processes, TimedOutError, WorkerDiedError
    from deqmcl_gym.validation import InputError, number

    number("--timeout", options.timeout, low=0, high=1e6, above=True)
    by_scenario = options.agent or options.scan
    if by_scenario and options.map is not None:
        raise InputError("--map is for localizers: with --agent or --scan give --scenario.")
    if options.scenario is not None and not by_scenario:
        raise InputError(
            "--scenario is for agents and scan models: give --agent or --scan, or --map for a "
            "localizer."
        )
    prepare()  # while this process loads what it needs
    from localizers.checks import LawVerdict, Report

    kind = "agents" if options.agent else "scan models" if options.scan else "localizers"
    subject = kind, options.name, options.scenario or options.map

    def attempt(law: str) -> LawVerdict:
        try:
            verdict: LawVerdict = worker.submit(_verdict, law, options.timeout, *subject).result()
            return verdict
        except TimedOutError:
            note = f"no answer within {options.timeout:g} s; --timeout S allows more"
        except WorkerDiedError as error:
            note = str(error)
        return LawVerdict(law, "FAILED", note)

    with Processes(1, timeout=options.timeout) as worker:
        with doing(f"loading {options.name}"):
            needs = worker.submit(_needs, options.timeout, *subject).result()
        report = Report(options.name, needs, attempt)
        for law in needs:
            with doing(f"trying the law {law!r}"):
                verdict = report.verdict(law)
            print(verdict, flush=True)
    verdicts, failed = report.verdicts, report.failed
    if failed:
        named = ", ".join(repr(verdict.law) for verdict in failed)
        at_once = subject[::2] == ("localizers", None) and failed[0] in verdicts[1:3]
        hint = " If it is for maps of cells alone, give one: --map MAP.yaml." * at_once
        words = f"{len(failed)} of {len(verdicts)} laws failed: {named}.{hint}"
        raise LawsBrokenError(words) from failed[0].error
    skipped = sum(verdict.status == "skipped" for verdict in verdicts)
    more = f" ({skipped} skipped)" if skipped else ""
    return f"{options.name} keeps all laws of {kind}{more}."


@cache
def _report(timeout: float, kind: str, name: str, where: str | None) -> "Report":
    """Load what is under check, in a worker once; an agent and a scan model in a scenario."""
    if kind != "localizers":
        from benchmarks.checks import check_agent, check_scan

        return (check_agent if kind == "agents" else check_scan)(name, where, time_limit=timeout)
    from deqmcl_gym.maps import GridMap
    from localizers.checks import LAWS
    from localizers.checks.subject import localizer_drive, robot_on
    from localizers.checks.verdicts import report_of

    robot = None if where is None else robot_on(GridMap.load(where))
    return report_of(replace(localizer_drive(name, robot), time_limit=timeout), LAWS)


def _needs(*subject: Any) -> Mapping[str, str | None]:
    return _report(*subject).needs


def _verdict(law: str, *subject: Any) -> "LawVerdict":
    """Try a law; an error, whose class another process may lack, is told by its traceback."""
    verdict = _report(*subject).attempt(law)
    if verdict.error is None:
        return verdict
    return replace(verdict, error=RuntimeError("".join(format_exception(verdict.error))))
