"""The commands of ``deqmcl``, one file each.

A file holds ``NAME``, ``HELP`` (one line), ``arguments(parser)`` and ``run(options) -> str``, what to
print; ``options.words`` are the words of the command line. The docstring of the file is what
``--help`` says. It imports what is heavy only where it runs, so that ``deqmcl --help`` stays fast.
"""

from collections.abc import Sequence
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

COMMANDS: Sequence[ModuleType] = (
    paper,
    sweep,
    report,
    verify,
    export,
    leaderboard,
    list_,
    run,
    replay,
    from_nav2,
    phase,
    check,
    new_localizer,
    new_map,
    speed,
)
