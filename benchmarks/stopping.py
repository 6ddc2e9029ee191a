"""Ctrl-C and SIGTERM: the first one ends a command in good order, later ones do not disturb it."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

_SOON = 0.05  # s


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
    ended, again, hook = False, None, sys.unraisablehook

    def end(number: int, _: object) -> NoReturn:
        nonlocal ended
        ended = True
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        raise Terminated if number == signal.SIGTERM else KeyboardInterrupt

    def dropped(unraisable: "sys.UnraisableHookArgs") -> None:
        nonlocal ended, again
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            hook(unraisable)
            return
        ended = False
        for each in before:
            signal.signal(each, end)
        number = signal.SIGTERM if unraisable.exc_type is Terminated else signal.SIGINT
        again = threading.Timer(_SOON, os.kill, (os.getpid(), number))
        again.daemon = True
        again.start()

    for number in before:
        signal.signal(number, end)
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = hook
        if again is not None:
            again.cancel()  # it has come, or all is done
        if not (ended and leaving):
            for number, handler in before.items():
                signal.signal(number, handler)
