"""``deqmcl check``."""

import argparse
from collections.abc import Sequence

NAME = "check"
HELP = "check that a localizer keeps the laws the benchmarks rely on"
DESCRIPTION = (
    "Try a localizer against named laws on a short random drive: one line each, ok, FAILED or "
    "skipped, with the reason. Exit code 3 if one failed."
)


class LawsBrokenError(RuntimeError):
    """A localizer breaks laws; which ones has been printed."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "name",
        metavar="NAME",
        help="a known name, package.module:NAME or path/to/file.py:NAME",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=60.0,
        metavar="S",
        help="seconds until a worker counts as hanging (60)",
    )


def run(options: argparse.Namespace, given: Sequence[str]) -> str:
    """Run the command, printing each law when it was tried; return the last lines."""
    del given
    from localizers.checks.run import Examination, milliseconds_per_step, subject_of

    subject = subject_of(options.name, timeout=options.timeout)
    tried, failed = [], []
    for verdict in Examination(subject).verdicts():
        print(verdict, flush=True)
        tried.append(verdict)
        if verdict.status == "FAILED":
            failed.append(verdict)
    if failed:
        words = f"{len(failed)} of {len(tried)} laws failed"
        named = ", ".join(repr(verdict.law) for verdict in failed)
        raise LawsBrokenError(f"{words}: {named}.") from failed[0].error
    skipped = sum(verdict.status == "skipped" for verdict in tried)
    return (
        f"time per step: {milliseconds_per_step(subject):.3g} ms, the median of a short drive\n"
        f"{options.name} keeps all laws"
        + (f" but {skipped} that do not concern it." if skipped else ".")
    )
