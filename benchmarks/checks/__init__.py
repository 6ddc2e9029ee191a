"""The laws of `deqmcl check` of agents and scan models, and how laws are tried, one by one."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from benchmarks.execution.processes import Processes, TimedOutError, WorkerDiedError
from localizers.checks.laws import Verdict
from localizers.checks.subject import LawBrokenError
from localizers.naming.plugins import is_ctrl_c, raised

T = TypeVar("T")


def tried(
    laws: Sequence[Callable[[T], None]], subject: T, name: str, *, foreign: bool, timeout: float
) -> Iterator[Verdict]:
    """Try laws on a subject, one after the other.

    Args:
        laws: raise ``LawBrokenError``, by ``require``, or whatever the subject raises.
        subject: what they are about.
        name: of it; what is before the last colon is left out of its tracebacks.
        foreign: whether it is code from elsewhere.
        timeout: s that a law may take, of code from elsewhere.
    """
    for law in laws:
        try:
            note = asked(foreign, timeout, _broken, law, subject, name)
        except (WorkerDiedError, TimedOutError) as error:
            note = str(error)
        words = law.__name__.replace("_", " ")
        broken = LawBrokenError(note) if note else None
        yield Verdict(words, "FAILED" if note else "ok", note, broken)


def asked(foreign: bool, timeout: float, function: Callable[..., Any], *given: object) -> Any:
    """Call a function, in another process if it runs code from elsewhere."""
    return apart(function, *given, timeout=timeout) if foreign else function(*given)


def apart(function: Callable[..., Any], *given: object, timeout: float) -> Any:
    """Call a function in a process of its own."""
    with Processes(1, timeout=timeout, guest_of=lambda *_: "a guest") as process:
        return process.submit(function, *given).result()


def require(holds: bool, otherwise: str) -> None:
    """Say how a law is broken, unless it holds."""
    if not holds:
        raise LawBrokenError(otherwise)


def _broken(law: Callable[[T], None], subject: T, name: str) -> str:
    """Return why a law is broken; "" if it holds."""
    try:
        law(subject)
    except LawBrokenError as error:
        return str(error)
    except BaseException as error:  # whatever it raises
        if is_ctrl_c(error):
            raise
        return f"it raised {raised(error, name.rpartition(':')[0])}"
    return ""
