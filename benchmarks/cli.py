"""The ``deqmcl`` command: parsing, exit codes and what is said of an error."""

import argparse
import difflib
import io
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from benchmarks.commands import COMMANDS

BAD_INPUT, FAILED, INTERRUPTED, TERMINATED = 2, 3, 130, 143


class Terminated(KeyboardInterrupt):
    """SIGTERM came: end as for Ctrl-C."""


class _Parser(argparse.ArgumentParser):
    """Says in one sentence what is wrong with a command line, and nothing else."""

    def error(self, message: str) -> NoReturn:
        sentence = message.rstrip(".")
        if message.startswith("unrecognized arguments: "):
            given = message.removeprefix("unrecognized arguments: ").split()[0]
            sentence = f"unknown argument {given!r}"
            known = [flag for action in self._actions for flag in action.option_strings]
            nearest = difflib.get_close_matches(given.split("=")[0], known, n=1)
            sentence += f" (did you mean {nearest[0]}?)" if nearest else ""
        print(f"{self.prog}: {sentence}; see {self.prog} --help.", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0 done, 2 bad input, 3 failed, 130 or 143 stopped."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # θ, for a terminal that has none
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = _parse(given)
    try:
        with _terminable(leaving=arguments is None):
            print(options.run(options, given))
    except KeyboardInterrupt as how:
        print("deqmcl: interrupted; finished trials are kept.", file=sys.stderr)
        return TERMINATED if isinstance(how, Terminated) else INTERRUPTED
    except SystemExit as end:  # no command of ours leaves so
        print(
            f"deqmcl: a plug-in called exit({end.code!r}); finished trials are kept.",
            file=sys.stderr,
        )
        return FAILED
    except Exception as error:
        if options.debug:
            raise
        return _explain(error)
    return 0


@contextmanager
def _terminable(*, leaving: bool) -> Iterator[None]:
    """Let the first Ctrl-C or SIGTERM unwind the stack, so that what was started is ended, too.

    Others that come meanwhile are ignored, which if ``leaving`` holds until the process is gone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    if before[signal.SIGINT] is not signal.default_int_handler:  # as for nohup
        del before[signal.SIGINT]
    ended = False

    def end(number: int, _: object) -> NoReturn:
        nonlocal ended
        ended = True
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        raise Terminated if number == signal.SIGTERM else KeyboardInterrupt

    for number in before:
        signal.signal(number, end)
    try:
        yield
    finally:
        if not (ended and leaving):
            for number, handler in before.items():
                signal.signal(number, handler)


def _explain(error: Exception) -> int:
    from deqmcl_gym.validation import InputError

    if isinstance(error, InputError):
        print(f"deqmcl: {error}", file=sys.stderr)
        return BAD_INPUT
    if isinstance(error, OSError) and error.strerror:
        words = f"{error.strerror}: {error.filename}" if error.filename else error.strerror
        print(f"deqmcl: {words}.", file=sys.stderr)
        return FAILED
    kind = "" if isinstance(error, RuntimeError) else f"{type(error).__name__}: "
    words = " ".join(str(error).split())  # on one line, whatever raised it
    print(f"deqmcl: {kind}{words} (--debug shows where)", file=sys.stderr)
    return FAILED


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="deqmcl",
        description="Benchmark of robot self-localization that knows its plan.",
        allow_abbrev=False,
    )
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    parsers: dict[str, _Parser] = {}
    for command in COMMANDS:
        own = subparsers.add_parser(
            command.NAME, allow_abbrev=False, help=command.HELP, description=command.DESCRIPTION
        )
        command.arguments(own)
        own.add_argument(
            "--debug", action="store_true", help="show a traceback when something fails"
        )
        own.set_defaults(run=command.run)
        parsers[command.NAME] = own
    options, unknown = parser.parse_known_args(arguments)
    if unknown:  # said by the command's own parser, which knows its flags
        parsers[options.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    return options
