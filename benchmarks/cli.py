"""The ``deqmcl`` command: parsing, exit codes and error messages."""

import argparse
import difflib
import errno
import gc
import io
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from benchmarks import console
from benchmarks.commands import COMMANDS, GONE, GONE_OPTIONS, GROUPS, MODULES

_IN_WORKERS = "check", "paper", "sweep", "verify"  # commands that call other processes at once
BAD_INPUT, FAILED, INTERRUPTED, NOT_READ, TERMINATED = 2, 3, 130, 141, 143
_DESCRIPTION = "Benchmark of self-localization for robots with a known plan." + "".join(
    f"\n\n{group}:\n" + "\n".join(f"  {name:<8}{words}" for name, words in commands.items())
    for group, commands in GROUPS.items()
)


class _Version(argparse.Action):
    """Print the version; the package that knows it is slow to load."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from deqmcl_gym import __version__

        console.say(f"deqmcl {__version__}")
        parser.exit()


class _Parser(argparse.ArgumentParser):
    """Says in one sentence what is wrong with a command line."""

    def print_help(self, _: object = None) -> None:
        """Print the help, or fail if that cannot be."""
        console.say(self.format_help().rstrip("\n"))

    def error(self, message: str) -> NoReturn:
        sentence, unknown = message.rstrip("."), message.partition("unrecognized arguments: ")[2]
        if unknown:
            word = unknown.split()[0]
            flag, sentence = word.split("=")[0], f"unknown argument {word!r}"
            flags = [name for action in self._actions for name in action.option_strings]
            if flag in flags:  # argparse knows the options of a command only after its name
                sentence = f"{flag} stands before the command: write it after {self.prog}"
            elif flag in GONE_OPTIONS:
                sentence = f"there is no {flag} here: write {GONE_OPTIONS[flag]}"
            elif nearest := difflib.get_close_matches(flag, flags, n=1):
                sentence += f" (did you mean {nearest[0]}?)"
        if message.endswith("expected one argument"):  # argparse takes -1,0,0 for a flag
            flag = message.removeprefix("argument ").split(":")[0]
            sentence += f" (write {flag}=VALUE if it begins with -)"
        from deqmcl_gym.validation import one_line

        print(f"{self.prog}: {one_line(sentence)}; see {self.prog} --help.", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code.

    0: done. 1: results differ from those before. 2: bad input. 3: failed. 4: a limit of --fail-if
    is broken. 130, 143: stopped by SIGINT or SIGTERM. 141: whoever read the output stopped
    reading, as after ``| head``.
    """
    argv = list(sys.argv[1:] if arguments is None else arguments)
    os.environ["MPLBACKEND"] = "agg"  # a notebook's may not be installed here
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # θ, for a terminal that has none
    console.open_streams()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", console.FailedWarning)
        try:
            code = _run(argv, leaving=arguments is None)
        except SystemExit as end:  # argparse leaves so
            code = int(end.code or 0)
        except console.OutputError as error:
            code = NOT_READ
            if not isinstance(why := error.__cause__, BrokenPipeError):
                code, words = FAILED, getattr(why, "strerror", why)
                print(f"deqmcl: the output cannot be written to stdout ({words}).", file=sys.stderr)
        if arguments is None:
            gc.freeze()  # at exit, a search for garbage would take half a second
        return code


def _run(argv: Sequence[str], *, leaving: bool) -> int:
    try:
        options = _parse(argv)
    except KeyboardInterrupt:
        print("deqmcl: interrupted.", file=sys.stderr)
        return INTERRUPTED
    try:
        with console.stoppable(leaving=leaving):
            _refuse_no_folder()
            if options.command in _IN_WORKERS and getattr(options, "dask", None) is None:
                from benchmarks.execution import prepare

                prepare()  # while this process loads what the command needs
            console.say(options.run(options))
    except KeyboardInterrupt as how:
        resumed = options.command in ("paper", "sweep", "tune")
        note = "; finished trials are kept" if resumed else ""
        print(f"deqmcl: interrupted{note}.", file=sys.stderr)
        return TERMINATED if isinstance(how, console.Terminated) else INTERRUPTED
    except SystemExit as end:  # no command of ours leaves so
        print(f"deqmcl: a plug-in called exit({end.code!r}).", file=sys.stderr)
        return FAILED
    except Exception as error:
        if options.debug or isinstance(error, console.OutputError):
            raise
        return _explain(error)
    return 0


def _refuse_no_folder() -> None:
    """Refuse to work in a folder that was deleted: no path can be made absolute in it."""
    try:
        os.getcwd()
    except OSError:
        from deqmcl_gym.validation import InputError

        raise InputError("the current folder is gone: change to one that exists.") from None


def _explain(error: Exception) -> int:
    from deqmcl_gym.validation import InputError, in_words, one_line

    if isinstance(error, InputError):
        print(f"deqmcl: {error}", file=sys.stderr)
        return BAD_INPUT
    if isinstance(error, OSError) and error.strerror:
        words = f"{error.strerror}: {error.filename}" if error.filename else error.strerror
        print(f"deqmcl: {one_line(words)}.", file=sys.stderr)
        return BAD_INPUT if error.errno == errno.ENAMETOOLONG else FAILED
    words = one_line(str(error)) if isinstance(error, RuntimeError) else ""
    code: int = getattr(error, "exit_code", FAILED)
    where = " (--debug shows where)" if code == FAILED else ""
    print(f"deqmcl: {words or in_words(error)}{where}", file=sys.stderr)
    return code


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    completing = "_ARGCOMPLETE" in os.environ  # set by a shell in which Tab was pressed
    typed = os.environ.get("COMP_LINE", "").split() if completing else arguments
    parser = _Parser(
        prog="deqmcl",
        usage="deqmcl [-h] [--version] COMMAND …",
        description=_DESCRIPTION,
        epilog="deqmcl COMMAND --help tells the options of one.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", prog="deqmcl", help=argparse.SUPPRESS
    )
    for name in COMMANDS:
        subparser = subparsers.add_parser(name, allow_abbrev=False)
        if name not in typed:
            continue
        module = next(module for module, names in MODULES.items() if name in names)
        command = getattr(import_module(f"benchmarks.commands.{module}"), f"{name}_command")
        command.arguments(subparser)
        traced = "show a traceback when something fails"
        subparser.add_argument("--debug", action="store_true", help=traced)
        subparser.set_defaults(run=command.run)
    if completing:
        import argcomplete

        argcomplete.autocomplete(parser)  # ends the process
    if arguments and arguments[0] in GONE:
        parser.error(f"{arguments[0]} is gone: {GONE[arguments[0]]}")
    options, unknown = parser.parse_known_args(arguments)
    options.words = ["deqmcl", *arguments]
    if unknown:  # said by the command's own parser, which knows its flags
        subparsers.choices[options.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    return options
