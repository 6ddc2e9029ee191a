"""What there is to name, how it is begun, and the laws that it must keep."""

import argparse
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from shlex import quote
from traceback import format_exception
from typing import TYPE_CHECKING, Any

from benchmarks.commands import command, option, path, switch
from benchmarks.console import doing, say

if TYPE_CHECKING:  # loaded when needed
    from localizers.checks import LawVerdict
    from localizers.checks.laws import Law
    from localizers.checks.subject import Subject

_KINDS = "suites", "localizers", "scenarios", "agents"
_FEW = 6  # shown of each kind
_FIRST = "paper", "quick", "lost-quick", "wrong-map-quick", "plan-sensor", "basin"  # of the suites


@command(
    option(
        "kind",
        nargs="?",
        metavar="|".join((*_KINDS, "LOCALIZER")),
        help="all of one kind; or what a localizer is, and its parameters",
    ),
    switch("--all", "all of every kind"),
)
def list_command(options: argparse.Namespace) -> str:
    """List suites, localizers, scenarios and agents; or describe a localizer."""
    from tabulate import tabulate

    from benchmarks.agents import AGENTS
    from benchmarks.setup.names import SCENARIOS, scenario
    from benchmarks.sweeps.sweepfile import SUITES, sweep_named
    from deqmcl_gym.validation import one_of
    from localizers import describe
    from localizers import names as localizer_names

    with doing("loading the localizers"):
        localizers = localizer_names()
    if options.kind is not None and options.kind not in _KINDS:
        if ":" not in options.kind and not options.kind.endswith(".py"):
            one_of("kind or localizer", options.kind, (*_KINDS, *localizers))
        return str(describe(options.kind))

    def size(name: str) -> str:
        sweep = sweep_named(name)
        return f"{sweep.planned:,} trials on {sweep.trials} worlds: {sweep.title}"

    suites = dict.fromkeys((*(name for name in _FIRST if name in SUITES), *SUITES))
    kinds: dict[str, tuple[str, Iterable[str], Callable[[str], str]]] = {
        "suites": ("deqmcl sweep NAME", suites, size),
        "localizers": ("deqmcl list NAME says what they take", localizers, _parameters),
        "scenarios": (
            "deqmcl sweep NAME, or --set scenario=NAME",
            SCENARIOS,
            lambda name: scenario(name).words,
        ),
        "agents": ("--set agent=NAME", AGENTS, lambda n: str(AGENTS[n].__doc__).partition("\n")[0]),
    }
    parts = []
    for kind in kinds if options.kind is None else [options.kind]:
        title, names, words_of = kinds[kind]
        shown = list(names)[: None if options.all or options.kind else _FEW]
        rows = [("", name, words_of(name)) for name in shown]
        if more := len(list(names)) - len(shown):
            rows.append(("", "…", f"{more} more: deqmcl list {kind}"))
        table = tabulate(rows, tablefmt="plain", disable_numparse=True)
        parts.append(f"{kind.capitalize()} ({title})\n{table}")
    return "\n\n".join(parts)


def _parameters(name: str) -> str:
    """Return a localizer's parameters; a plug-in that cannot be loaded must not spoil the list."""
    from deqmcl_gym.validation import one_line
    from localizers import parameters

    try:
        names = parameters(name)
    except Exception as error:
        return f"cannot be loaded: {one_line(str(error))}"
    return "any parameters" if names is None else ", ".join(names)


_OFFICE = (  # parameters of ``Office``, each with its own default
    ("seed", int, "seed of the building (0)"),
    ("wings", int, "wings side by side, 1 to 8, each 16 to 24 m long (2)"),
    ("corridors", int, "corridors through all wings, 1 to 6 (2)"),
    ("corridor", float, "width of all corridors, m (2.0)"),
    ("door", float, "width of all doors, m (0.9)"),
    ("repeated", bool, "make all wings identical"),
    ("symmetric", bool, "make the building the same after a half turn"),
)


def _new(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="localizer|map")
    words = "a file with a small working localizer, class MyLocalizer"
    localizer = kinds.add_parser("localizer", allow_abbrev=False, help=words)
    option("file", type=path, metavar="FILE.py", help="the file; must not exist yet")(localizer)
    words = "an office from a seed: a ROS map of 0.1 m cells"
    office = kinds.add_parser("map", allow_abbrev=False, help=words, description=f"Write {words}.")
    for name, kind, meaning in _OFFICE:
        how: Any = {"action": "store_true"} if kind is bool else {"type": kind, "metavar": "N"}
        office.add_argument(f"--{name}", default=argparse.SUPPRESS, help=meaning, **how)
    option("--out", type=path, required=True, metavar="DIR", help="a new or empty folder")(office)


@command(_new)
def new_command(options: argparse.Namespace) -> str:
    """Write something to start from: a small working localizer, or a building as a map."""
    return _map(options) if options.kind == "map" else _localizer(options.file)


def _localizer(path: Path) -> str:
    from deqmcl_gym.files import write_text
    from deqmcl_gym.validation import InputError

    if "," in str(path):
        raise InputError(f"the new file is {path}, but --with takes names separated by commas.")
    if path.suffix != ".py":
        raise InputError(f"the new file is {path}, but must end in .py, as in my_localizer.py.")
    if path.exists() or path.is_symlink():
        raise InputError(f"the new file {path} already exists: choose another name.")
    if not path.parent.is_dir():
        raise InputError(f"the folder of the new file {path} does not exist: create it.")
    template = Path(__file__).parents[2] / "localizers" / "template.py"
    write_text(path, template.read_text(encoding="utf-8"))
    name = quote(f"{path if path.is_absolute() else f'./{path}'}:MyLocalizer")
    return (
        f"Written: {path}, a working localizer. Check it and run it:\n"
        f"  deqmcl check {name}\n"
        f"  deqmcl sweep quick --with {name} --out results/mine"
    )


def _map(options: argparse.Namespace) -> str:
    from deqmcl_gym.files import writable_folder
    from deqmcl_gym.maps import Office
    from deqmcl_gym.validation import InputError

    values = vars(options)
    office = Office(**{name: values[name] for name, _, _ in _OFFICE if name in values})
    out: Path = options.out
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"the output folder {out} is not empty: give a new or an empty one.")
    office.grid.save(writable_folder(out) / "office.yaml")
    _, _, width, height = office.grid.bounds
    return (
        f"Written to {out}: an office of {width:.1f} x {height:.1f} m, as office.yaml with "
        f'office.pgm. Drive in it: floor_plan = "{out / "office.yaml"}".'
    )


class LawsBrokenError(RuntimeError):
    """A localizer, an agent or a scan model breaks laws, which have been printed."""


def _kind_of_plug_in(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_mutually_exclusive_group()
    switch("--agent", "NAME is of an agent")(kinds)
    switch("--scan", "NAME is of a scan model")(kinds)


@command(
    option("name", metavar="NAME", help="a name (deqmcl list), package.module:NAME or "
        "path/to/file.py[:NAME]"),
    option("--map", metavar="MAP.yaml", help="try it on this map, in m, instead of a small room"),
    _kind_of_plug_in,
    option("--scenario", metavar="NAME", help="where an agent drives (guided or driving), or whose "
        "map and lidar a scan model is for (sharp or, if it needs a map of cells, lost)"),
    option("--timeout", type=float, default=60.0, metavar="S", help="seconds allowed per law (60)"),
)  # fmt: skip
def check_command(options: argparse.Namespace) -> str:
    """Check a localizer, an agent or a scan model against named laws.

    One line per law: ok, FAILED or skipped, with the reason. Exit code 3 if a law fails.
    """
    from benchmarks.execution.processes import Processes, TimedOutError, WorkerDiedError
    from deqmcl_gym.validation import InputError, number

    number("--timeout", options.timeout, low=0, high=1e6, above=True)
    kind = "agents" if options.agent else "scan models" if options.scan else "localizers"
    if (options.map if kind != "localizers" else options.scenario) is not None:
        raise InputError(
            "--map is for localizers, --scenario for agents and scan models: give the other one."
        )
    from benchmarks.checks import KINDS
    from localizers.checks import LawVerdict, Report, law_name

    subject = kind, options.name, options.scenario or options.map, options.timeout

    @cache
    def attempt(law: "Law") -> Any:
        try:
            return worker.submit(_verdict, law, *subject).result()
        except TimedOutError:
            note = f"no answer within {options.timeout:g} s; --timeout S allows more"
        except WorkerDiedError as error:
            note = str(error)
        return LawVerdict(law_name(law), "FAILED", note)

    report = Report(options.name, KINDS[kind][1], attempt)
    with Processes(1, timeout=options.timeout) as worker:
        for law in report.laws:
            with doing(f"trying the law {law_name(law)!r}"):
                verdict = report.verdict(law)
            say(str(verdict))
    verdicts, failed = report.verdicts, report.failed
    if failed:
        named = ", ".join(repr(verdict.law) for verdict in failed)
        at_once = kind == "localizers" and options.map is None and failed[0] in verdicts[1:3]
        hint = " If it is for maps of cells alone, give one: --map MAP.yaml." * at_once
        words = f"{len(failed)} of {len(verdicts)} laws failed: {named}.{hint}"
        raise LawsBrokenError(words) from failed[0].error
    skipped = [verdict for verdict in verdicts if verdict.status == "skipped"]
    more = f" ({len(skipped)} skipped)" if skipped else ""
    return f"{options.name} keeps all laws of {kind}{more}."


@cache
def _subject(kind: str, name: str, where: str | None, timeout: float) -> "Subject":
    """Load what is under check, in a worker once."""
    from benchmarks.checks import KINDS

    return replace(KINDS[kind][0](name, where), time_limit=timeout)


def _verdict(law: "Law", *subject: Any) -> "LawVerdict":
    """Try a law; an error, whose class another process may lack, is told by its traceback."""
    from localizers.checks import verdict_on

    verdict = verdict_on(_subject(*subject), law)
    if verdict.error is None:
        return verdict
    return replace(verdict, error=RuntimeError("".join(format_exception(verdict.error))))
