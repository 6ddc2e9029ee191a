"""``deqmcl check``."""

import argparse
from collections.abc import Sequence

from benchmarks.console import doing

NAME = "check"
HELP = "check that a localizer obeys the laws the benchmarks rely on"
DESCRIPTION = (
    "Check a localizer against named laws on a short random drive. One line per law: ok, FAILED or "
    "skipped, with the reason. Exit code 3 if a law fails."
)


class LawsBrokenError(RuntimeError):
    """A localizer breaks laws, which have been printed."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "name",
        metavar="NAME",
        help="a name (deqmcl list), package.module:NAME or path/to/file.py[:NAME]",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=60.0,
        metavar="S",
        help="seconds allowed per law (60)",
    )


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command, printing each law as it is tried; return the last lines."""
    del given
    from contextlib import closing

    from localizers.checks.laws import LAWS
    from localizers.checks.run import examined
    from localizers.naming.registry import complete

    name = complete(options.name)
    with doing(f"loading {name}"):
        examination = examined(name, timeout=options.timeout)
    with closing(examination):
        tried = []
        for law in LAWS:
            with doing(f"trying the law {law.name!r}"):
                tried.append(examination.verdict(law))
            print(tried[-1], flush=True)
        failed = [verdict for verdict in tried if verdict.status == "FAILED"]
        if failed:
            words = f"{len(failed)} of {len(tried)} laws failed"
            named = ", ".join(repr(verdict.law) for verdict in failed)
            raise LawsBrokenError(f"{words}: {named}.") from failed[0].error
        milliseconds = examination.milliseconds_per_step()
    skipped = sum(verdict.status == "skipped" for verdict in tried)
    return (
        f"time per step: {milliseconds:.3g} ms, the median of a short drive\n"
        f"{name} keeps all laws" + (f" ({skipped} skipped)." if skipped else ".")
    )
