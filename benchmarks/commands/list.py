"""List suites, localizers, scenarios and agents."""

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING

from benchmarks.console import doing

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.design import Sweep


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--suites", action="store_true", help="only the suites")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.agents import AGENTS
    from benchmarks.setup.names import scenario, scenario_names
    from benchmarks.sweeps.suites import SUITES, sweep_named
    from localizers import names

    sweeps = {name: sweep_named(name) for name in SUITES}
    suites = [(name, f"{_size(sweep)}: {sweep.title}") for name, sweep in sweeps.items()]
    shown = f"Suites (deqmcl sweep NAME --out DIR; --dry-run estimates the time)\n{_lines(suites)}"
    if options.suites:
        return shown
    with doing("loading the localizers"):
        localizers = [(name, _parameters(name)) for name in names()]
    agents = [(name, str(agent.__doc__).partition("\n")[0]) for name, agent in AGENTS.items()]
    return "\n\n".join(
        (
            shown,
            f"Localizers and their parameters\n{_lines(localizers)}",
            f"Scenarios\n{_lines((name, scenario(name).words) for name in scenario_names())}",
            f"Agents\n{_lines(agents)}",
        )
    )


def _parameters(name: str) -> str:
    """Return a localizer's parameters; a plug-in that cannot be loaded must not spoil the list."""
    from deqmcl_gym.validation import one_line
    from localizers import parameters

    try:
        known = parameters(name)
    except Exception as error:
        return f"cannot be loaded: {one_line(str(error))}"
    return "any parameters" if known is None else ", ".join(known)


def _size(sweep: "Sweep") -> str:
    return f"{sweep.planned:,} trials on {sweep.trials} worlds"


def _lines(rows: Iterable[tuple[str, str]]) -> str:
    listed = list(rows)
    width = max(len(name) for name, _ in listed)
    return "\n".join(f"  {name:<{width}}  {words}".rstrip() for name, words in listed)
