"""The commands of ``deqmcl``, a function each: ``NAME_command(options) -> str``, what to print.

Its docstring is what ``--help`` says, its decorator has its options; those that several share are
here. What is heavy is imported where it runs, so that ``deqmcl new --help`` stays fast.
"""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

GROUPS = {  # of the commands
    "for everybody": {
        "paper": "run the paper's experiment: Table 1, figures, report",
        "run": "run one lap: animation, errors, trajectories",
        "sweep": "run a suite, a scenario or a sweep file; resumable, on one or many machines",
        "report": "rewrite the report of a folder of results, or write one of several",
        "check": "check that a localizer obeys the laws the benchmarks rely on",
        "list": "list suites, localizers, scenarios and agents; describe a localizer",
    },
    "for robots": {
        "replay": "play a recorded log to localizers, and compare them",
        "score": "score what another stack has estimated, with the columns of replay",
        "smooth": "make a reference of a log that has none, and judge it",
        "tune": "search the parameters of a localizer on your logs",
    },
    "for authors": {
        "new": "write a small working localizer, or a generated building, to start from",
        "verify": "see whether today's code, libraries and plug-ins get the numbers in a folder",
    },
}
COMMANDS = {name: words for group in GROUPS.values() for name, words in group.items()}
MODULES = {  # that they are in
    "experiments": ("paper", "run", "sweep", "report", "verify"),
    "logs": ("replay", "score", "smooth", "tune"),
    "plug_ins": ("check", "list", "new"),
}
GONE = {  # said to whoever still types them
    "basin": "deqmcl sweep basin --set world.log=LOG --set world.map=MAP.yaml asks that",
    "export": "deqmcl report DIR --latex --pdf writes them into DIR/export",
    "from-nav2": "deqmcl replay LOG --map MAP.yaml --nav2 FILE --dry-run prints the sweep file",
    "leaderboard": "deqmcl report A B C --out DIR makes one report of folders of the same worlds",
    "new-localizer": "deqmcl new localizer FILE.py writes one",
    "new-map": "deqmcl new map --out DIR writes one",
    "phase": "in a clone, docs/examples/theta_phase.py draws the queue as theta phase",
    "speed": "in a clone, python -m benchmarks.studies.speed --out DIR measures it",
}
GONE_OPTIONS = {
    "--adopt": "deqmcl verify DIR first, and then the same command",
    "--agent": "--set agent=NAME",
    "--agents": "--set vary.agent=[A,B]",
    "--changed-walls": "--set world.changed_walls.share=0.3",
    "--covariance": "columns var_x, cov_xy, … in a CSV of the estimate",
    "--executor": "--dask",
    "--max-beams": "--set world.max_beams=60",
    "--motion": "--set assumed.motion.alpha1=0.1, and so on for each",
    "--param": "--set params.LOCALIZER.KEY=VALUE",
    "--particles": "--set params.particles=300",
    "--radius": "--set world.radius=0.2",
    "--read": "--set world.reading.NAME=VALUE",
    "--scan": "--set assumed.scan.sigma=0.1, and so on for each",
    "--scheduler": "--dask ADDRESS",
    "--smooth": "deqmcl smooth LOG --map MAP.yaml --start S --out DIR",
    "--suites": "deqmcl list suites",
    "--unknown": "--set world.unknown=free",
}

Option = Callable[[Any], object]  # adds itself to a parser, or to a group of its options


class Command(NamedTuple):
    """A command: what it runs, and its options."""

    run: Callable[[argparse.Namespace], str]
    options: Sequence[Option]

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add its words and its options to a parser."""
        parser.description = self.run.__doc__
        for add in self.options:
            add(parser)


def command(*options: Option) -> Callable[[Callable[[argparse.Namespace], str]], Command]:
    """Make a command of a function, with these options."""
    return lambda run: Command(run, options)


def option(*names: str, **how: Any) -> Option:
    """Declare an option, or a positional argument, as argparse has it."""
    return lambda parser: parser.add_argument(*names, **how)


def switch(name: str, words: str) -> Option:
    """Declare an option without a value."""
    return option(name, action="store_true", help=words)


def group(title: str, *options: Option) -> Option:
    """Declare options that ``--help`` shows under a title."""

    def add(parser: argparse.ArgumentParser) -> None:
        inside = parser.add_argument_group(title)
        for each in options:
            each(inside)

    return add


def path(text: str) -> Path:
    """Return the path of an argument; "" would be the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty: name a file, or a folder as results/mine")
    return Path(text)


def share(text: str) -> float:
    """Return 5% or 0.05 as a number."""
    number, percent, _ = text.strip().partition("%")
    try:
        return float(number) / 100 if percent else float(number)
    except ValueError:
        raise argparse.ArgumentTypeError(f"it is {text!r}: give a share, as 5% or 0.05") from None


JOBS = option("--jobs", type=int, metavar="J", help="trials or runs at a time (one per processor)")
_VIEWED = "also write what is believed, for Foxglove and Lichtblick (needs the extra view)"
MCAP = option("--mcap", type=path, metavar="FILE.mcap", help=_VIEWED)
RETRY_FAILED = switch("--retry-failed", "run again what failed before")
_ALLOWED = "seconds allowed per trial or run (no limit; for a plug-in 3600)"
TIMEOUT = option("--timeout", type=float, metavar="S", help=_ALLOWED)


def out(default: str | None = None, *, without: str | None = None) -> Option:
    """Declare the output folder; it must be given if there is neither a default nor ``without``.

    The help shows the latter in place of a default, and the command gets None.
    """
    usual = default or without
    words = "output folder" if usual is None else f"output folder ({usual})"
    how: dict[str, Any] = {"default": default, "required": usual is None, "help": words}
    return option("--out", type=path, metavar="DIR", **how)


def seed(default: int | None = 0) -> Option:
    """Declare the root seed; None: that of the sweep."""
    words = f"root of all randomness ({'as in the sweep' if default is None else default})"
    return option("--seed", type=int, default=default, metavar="S", help=words)


def settings(
    example: str = "params.mcl.particles=500",
    names: str = "world.…, assumed.…, params.… and others, docs/sweeps.md",
) -> Option:
    """Declare single values by the names that a sweep file has, of which the command takes some."""
    words = f"a value by its name in a sweep file, as {example}: {names} (one --set each)"
    return option("--set", action="append", default=[], metavar="NAME=VALUE", help=words)


def trials(default: int | None = None) -> Option:
    """Declare the number of worlds; None: that of the sweep."""
    words = f"worlds of each setting ({'as in the sweep' if default is None else default})"
    return option("--trials", type=int, default=default, metavar="K", help=words)


def localizers_named(listed: str) -> tuple[str, ...]:
    """Return the names in ``a,b,c``, without blanks; ``file.py`` is its only localizer."""
    from localizers.registry import LOCALIZER

    return tuple(LOCALIZER.complete(name) for part in listed.split(",") if (name := part.strip()))
