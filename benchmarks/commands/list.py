"""List suites, localizers, scenarios and agents; or describe a localizer."""

import argparse
from collections.abc import Sequence

from benchmarks.console import doing

_KINDS = "suites", "localizers", "scenarios", "agents"
_FEW = 6  # shown of each kind
_FIRST = "paper", "quick", "lost-quick", "wrong-map-quick", "plan-sensor", "basin"  # of the suites


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("kind", nargs="?", metavar="|".join((*_KINDS, "LOCALIZER")),
        help="all of one kind; or what a localizer is, and its parameters")  # fmt: skip
    add("--all", action="store_true", help="all of every kind")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.agents import AGENTS
    from benchmarks.setup.names import scenario_names
    from benchmarks.sweeps.suites import SUITES
    from deqmcl_gym.validation import one_of
    from localizers import describe, names

    with doing("loading the localizers"):
        localizers = list(names())
    name = options.kind
    if name is not None and name not in _KINDS:
        if ":" not in name and not name.endswith(".py"):
            one_of("kind or localizer", name, (*_KINDS, *localizers))
        return str(describe(name))
    first = [name for name in _FIRST if name in SUITES]
    kinds = {
        "suites": ("deqmcl sweep NAME", [*first, *(n for n in SUITES if n not in first)], _suite),
        "localizers": ("deqmcl list NAME says what they take", localizers, _parameters),
        "scenarios": ("deqmcl sweep NAME, or --set scenario=NAME", scenario_names(), _scenario),
        "agents": ("--set agent=NAME", list(AGENTS), lambda name: _first_line(AGENTS[name])),
    }
    parts = []
    for kind in kinds if options.kind is None else [options.kind]:
        words, listed, told = kinds[kind]
        shown = listed if options.all or options.kind else listed[:_FEW]
        rows = [(name, told(name)) for name in shown]
        if len(shown) < len(listed):
            rows.append(("…", f"{len(listed) - len(shown)} more: deqmcl list {kind}"))
        parts.append(f"{kind.capitalize()} ({words})\n{_lines(rows)}")
    return "\n\n".join(parts)


def _suite(name: str) -> str:
    from benchmarks.sweeps.suites import sweep_named

    sweep = sweep_named(name)
    return f"{sweep.planned:,} trials on {sweep.trials} worlds: {sweep.title}"


def _scenario(name: str) -> str:
    from benchmarks.setup.names import scenario

    return scenario(name).words


def _first_line(thing: object) -> str:
    return str(thing.__doc__).partition("\n")[0]


def _parameters(name: str) -> str:
    """Return a localizer's parameters; a plug-in that cannot be loaded must not spoil the list."""
    from deqmcl_gym.validation import one_line
    from localizers import parameters

    try:
        known = parameters(name)
    except Exception as error:
        return f"cannot be loaded: {one_line(str(error))}"
    return "any parameters" if known is None else ", ".join(known)


def _lines(rows: Sequence[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"  {name:<{width}}  {words}".rstrip() for name, words in rows)
