"""The terminal that a command runs in: its streams, its words while it works, its Ctrl-C."""

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import NoReturn


class FailedWarning(UserWarning):
    """Trials failed. A command says so with its exit code, last."""


PATIENCE = 1.0  # s before a user is told what takes so long


@contextmanager
def beside(tell: Callable[[threading.Event], None]) -> Iterator[None]:
    """Run ``tell(done)`` in a thread until it returns, which it does once ``done`` is set."""
    done = threading.Event()
    teller = threading.Thread(target=tell, args=(done,), daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


@contextmanager
def doing(what: str) -> Iterator[None]:
    """Say on stderr what is being done, if it takes longer than ``PATIENCE``.

    A terminal gets a line that counts the seconds and disappears at the end.
    """

    def tell(done: threading.Event) -> None:
        began = time.monotonic()
        if done.wait(PATIENCE):
            return
        from deqmcl_gym.validation import one_line  # not before: --help loads nothing heavy

        words = one_line(what)
        if not sys.stderr.isatty():
            print(f"deqmcl: {words} …", file=sys.stderr, flush=True)
            return
        waiting = True
        while waiting:
            line = f"{words} … {time.monotonic() - began:.0f} s"
            print(f"\r{line}", end="", file=sys.stderr, flush=True)
            waiting = not done.wait(1.0)
        print(f"\r{' ' * len(line)}\r", end="", file=sys.stderr, flush=True)

    with beside(tell):
        yield


def warn(sentences: Iterable[str | None]) -> list[str]:
    """Say on stderr what is not None; return it, with the word Warning."""
    lines = [f"Warning: {sentence.rstrip('.')}." for sentence in sentences if sentence is not None]
    for line in lines:
        print(f"deqmcl: {line}", file=sys.stderr)
    return lines


@contextmanager
def log_warnings() -> Iterator[list[str]]:
    """Collect the warnings of log readers, each sentence once; if all fails, say them."""
    from deqmcl_gym.validation import LogWarning

    sentences, failed = list[str](), True
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", LogWarning)
        try:
            yield sentences
            failed = False
        finally:
            of_logs = [w.message for w in caught if issubclass(w.category, LogWarning)]
            sentences += dict.fromkeys(map(str, of_logs))
            if failed:
                warn(sentences)


@contextmanager
def checking() -> Iterator[None]:
    """Say that all worlds and localizers are being checked, and what is wrong with their logs."""
    with doing("checking every world and localizer"), log_warnings() as sentences:
        yield
    warn(sentences)


def open_streams() -> None:
    """Lead closed standard streams to the null device, or the next file gets their number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


class OutputError(Exception):
    """Stdout does not take what is written, because of its cause."""


def say(text: str) -> None:
    """Print a text at once; if stdout does not take it, the null device takes what is left."""
    try:
        print(text, flush=True)
    except OSError as error:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # of which Python flushes the rest when it ends
        os.close(nowhere)
        raise OutputError from error


class Terminated(KeyboardInterrupt):
    """SIGTERM came: end as for Ctrl-C."""


@contextmanager
def stoppable(*, leaving: bool) -> Iterator[None]:
    """Let the first Ctrl-C or SIGTERM unwind the stack, so that what was started is also ended.

    Later ones are ignored meanwhile; if ``leaving``, until the process is gone. Python drops what
    is raised in a callback of C, as llvmlite has some, or in a ``__del__``: then it is raised anew.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    if before[signal.SIGINT] is not signal.default_int_handler:  # as for nohup
        del before[signal.SIGINT]
    ended: type[KeyboardInterrupt] | None = None
    again, hook = None, sys.unraisablehook

    def end(number: int, _: object) -> NoReturn:
        nonlocal ended
        ended = Terminated if number == signal.SIGTERM else KeyboardInterrupt
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        raise ended

    def dropped(unraisable: "sys.UnraisableHookArgs") -> None:
        nonlocal ended, again
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            hook(unraisable)
            return
        ended = None
        for each in before:
            signal.signal(each, end)
        number = signal.SIGTERM if unraisable.exc_type is Terminated else signal.SIGINT
        again = threading.Timer(0.05, os.kill, (os.getpid(), number))
        again.daemon = True
        again.start()

    for number in before:
        signal.signal(number, end)
    sys.unraisablehook = dropped
    try:
        yield
    except Exception as error:
        if ended is not None:  # made another error of, as NumPy does while it is imported
            raise ended from error
        raise
    finally:
        sys.unraisablehook = hook
        if again is not None:
            again.cancel()  # it has come, or all is done
        if ended is None or not leaving:
            for number, handler in before.items():
                signal.signal(number, handler)
