"""The commands of ``deqmcl``, one file each.

A file holds ``HELP`` (one line), ``arguments(parser)`` and ``run(options) -> str``, what to print;
``options.words`` are the words of the command line. Its docstring is what ``--help`` says. It
imports what is heavy only where it runs, so that ``deqmcl --help`` stays fast.
"""

from collections.abc import Mapping
from types import ModuleType

from benchmarks.commands import (
    check,
    export,
    from_nav2,
    leaderboard,
    new_localizer,
    new_map,
    paper,
    phase,
    replay,
    report,
    run,
    speed,
    sweep,
    verify,
)
from benchmarks.commands import list as list_

COMMANDS: Mapping[str, ModuleType] = {
    "paper": paper,
    "sweep": sweep,
    "report": report,
    "verify": verify,
    "export": export,
    "leaderboard": leaderboard,
    "list": list_,
    "run": run,
    "replay": replay,
    "from-nav2": from_nav2,
    "phase": phase,
    "check": check,
    "new-localizer": new_localizer,
    "new-map": new_map,
    "speed": speed,
}
