"""A separate process for a localizer under check."""

import atexit
import multiprocessing
from collections.abc import Callable
from typing import Any

from localizers.checks.subject import LawBrokenError
from localizers.naming.isolation import end


class Spawned:
    """A process that answers questions; if it does anything else, it breaks a law."""

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:
        """Start ``target(line, *arguments)``."""
        context = multiprocessing.get_context("spawn")
        self._line, there = context.Pipe()
        self._process = context.Process(target=target, args=(there, *arguments))
        self._process.start()
        there.close()
        atexit.register(self.close)

    def ask(self, question: object) -> None:
        """Send a question."""
        self._line.send(question)

    def answer(self, timeout: float) -> Any:
        """Return what it sends next.

        Raises:
            LawBrokenError: it ends, or has sent nothing after ``timeout`` s.
        """
        try:
            if self._line.poll(timeout):
                return self._line.recv()
        except (EOFError, OSError):
            self._process.join(1)
            code = self._process.exitcode
            raise LawBrokenError(
                f"a separate process ended without an answer, with exit code {code}"
            ) from None
        raise LawBrokenError(f"a separate process gave no answer within {timeout:g} s")

    def close(self) -> None:
        """Kill the process and all that it started."""
        atexit.unregister(self.close)
        end(self._process)
        self._process.join()
        self._line.close()
