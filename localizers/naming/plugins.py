"""Localizers from other people's code: ``package.module:NAME``, ``file.py:NAME``.

What a file has is found by parsing it. Loading runs its code, so it happens only when a plug-in is
used, and any failure is reported in one sentence, as an ``InputError``.

Whatever such code does to its process (working folder, streams, signals, threads, random state,
``os._exit``) ends with the process. The parent kills it, with everything it started, and waits for
none of its cleanup.
"""

import ast
import atexit
import builtins
import contextlib
import difflib
import hashlib
import importlib
import importlib.util
import multiprocessing
import os
import pkgutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from types import ModuleType
from typing import Any, Self

from deqmcl_gym.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError, in_words
from localizers.naming.digests import file_digest, module_digest

SPAWN = multiprocessing.get_context("spawn")
_MODULE = "_localizer_"  # begins the name of a module that is a file of its own
_ELSEWHERE = "…"
SAFE_PATH = {"PYTHONSAFEPATH": "deqmcl"}  # in the environment; any text switches it on
_MARK = "DEQMCL_PROCESS"  # in the environment of all that the process starts
_EXEC_SECONDS = 0.02  # a program that is just being started does not show its environment yet
_OOM_SCORE = "500"  # who is killed first when memory runs out: this process, not its parent


class NoAnswerError(RuntimeError):
    """A process gave no answer in time, or ended."""


class EndedError(NoAnswerError):
    """A process ended without an answer.

    Attributes:
        code: its exit code; None if it has none yet.
    """

    def __init__(self, code: int | None) -> None:
        super().__init__(f"a separate process ended without an answer, with exit code {code}")
        self.code = code


class OwnProcess:
    """A process that calls ``enter`` and answers questions, and our end of the line to it."""

    def __init__(
        self, context: BaseContext, target: Callable[..., None], *arguments: object
    ) -> None:
        """Start ``target(line, *arguments)``."""
        self._line, there = context.Pipe()
        self.process: BaseProcess = context.Process(  # type: ignore[attr-defined]
            target=target, args=(there, *arguments)
        )
        with safe_path():
            self.process.start()
        there.close()  # so that the line breaks when the process dies
        atexit.register(self.kill)  # multiprocessing would wait for it

    def answer(self, timeout: float | None, *question: object) -> Any:
        """Return what the process sends next, after it was sent a question if there is one.

        Raises:
            EndedError: it ended.
            NoAnswerError: it has sent nothing after ``timeout`` s.
        """
        try:
            for one in question:
                self._line.send(one)
            if self._line.poll(timeout):
                return self._line.recv()
        except (EOFError, OSError):
            self.process.join(1)
            raise EndedError(self.process.exitcode) from None
        raise NoAnswerError(f"a separate process gave no answer within {timeout:g} s")

    def kill(self) -> None:
        """Kill the process, if it still lives, and all that it started."""
        end(self.process)

    def close(self) -> None:
        """Kill the process, wait for its end, and close the line."""
        atexit.unregister(self.kill)
        self.kill()
        self.process.join()
        self._line.close()


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Let interpreters that start now find nothing in the working folder, until they ``enter``.

    multiprocessing starts them by ``python -c``, which looks there first.
    """
    before = {name: os.environ[name] for name in SAFE_PATH if name in os.environ}
    os.environ.update(SAFE_PATH)
    try:
        yield
    finally:
        del os.environ["PYTHONSAFEPATH"]
        os.environ.update(before)


def enter(line: Connection) -> None:
    """Prepare this process to be killed as a whole; call it first.

    It leads its own session, prints to stderr, and does not outlive its parent. What a plug-in
    forks is not on the line: answers come from this process alone.
    """
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=line.close)
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; it leads one already
        os.setsid()
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_OOM_SCORE)
    with contextlib.suppress(OSError):  # stderr is closed
        os.dup2(2, 1)
    os.environ[_MARK] = str(os.getpid())
    if SAFE_PATH.items() <= os.environ.items():  # its programs start as ever
        del os.environ["PYTHONSAFEPATH"]
    Thread(target=_leave_with_parent, daemon=True).start()


def is_ctrl_c(error: BaseException) -> bool:
    """Whether an error is the user's Ctrl-C; in a worker it can only come from a plug-in."""
    return isinstance(error, KeyboardInterrupt) and multiprocessing.parent_process() is None


def end(process: BaseProcess) -> None:
    """Kill a process that called ``enter``, and all it started, in other sessions too."""
    if process.pid is not None:
        _kill_session(process.pid)
        process.kill()
        _kill_marked(process.pid)


def _kill_session(leader: int) -> None:
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; none is left
        os.killpg(leader, signal.SIGKILL)


def _kill_marked(leader: int) -> None:
    """Kill programs that were started with the mark of a process, whatever session they are in."""
    mark = f"{_MARK}={leader}".encode()
    for pause in (0.0, _EXEC_SECONDS):
        time.sleep(pause)
        for environment in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):  # it is gone, or another user's
                if mark in environment.read_bytes().split(b"\0"):
                    os.kill(int(environment.parent.name), signal.SIGKILL)


def _leave_with_parent() -> None:
    """Exit at once when the parent is gone, whatever else is running."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        _kill_marked(os.getpid())
        _kill_session(os.getpid())
        os._exit(1)


def is_file(name: str) -> bool:
    """Whether a name is that of a Python file, without the name of anything in it."""
    return name.endswith(".py")


def classes_in(file: str, verbs: Collection[str]) -> list[str]:
    """Return the names of the public classes in a file that have these methods.

    If none has them itself, those that may inherit them from a class that is imported.

    Raises:
        InputError: the file cannot be read, or is not Python.
    """
    try:
        tree = ast.parse(content_of(Path(os.path.expanduser(file))), file)
    except FileNotFoundError as error:
        raise InputError(f"the file {file} cannot be read: {error.strerror}.") from None
    except UnreadableError as error:
        raise InputError(f"the file {file} {error}.") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # ValueError: a NUL
        raise InputError(f"the file {file} cannot be parsed as Python: {error}.") from None
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    public = {name: _methods(name, classes) for name in classes if not name.startswith("_")}
    having = [name for name, own in public.items() if {*verbs} <= own]
    return having or [name for name, own in public.items() if _ELSEWHERE in own]


def _methods(name: str, classes: Mapping[str, ast.ClassDef]) -> set[str]:
    """Names of the methods of a class, also of those that it inherits from others in the file.

    ``_ELSEWHERE`` stands for those of a class that is imported.
    """
    if name not in classes:
        return set() if hasattr(builtins, name) else {_ELSEWHERE}
    own, others = classes[name], {key: value for key, value in classes.items() if key != name}
    found = {node.name for node in own.body if isinstance(node, ast.FunctionDef)}
    return found.union(*(_methods(ast.unparse(base), others) for base in own.bases))


class Placed(str):
    """A name as a file says it, with its path from there; it is found wherever it is taken.

    Attributes:
        place: the same with an absolute path.
    """

    place: str

    def __new__(cls, said: str, place: str) -> Self:
        """Make a name that is told as ``said``."""
        made = super().__new__(cls, said)
        made.place = place
        return made

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        return str(self), self.place

    def __add__(self, end: str) -> "Placed":
        return Placed(f"{self}{end}", self.place + end)


def is_reference(name: str) -> bool:
    """Whether a name says where the code is, as ``package.module:NAME`` or ``file.py:NAME``."""
    return ":" in name


def absolute_name(name: str) -> str:
    """Return a name by which a process in any other folder finds the same localizer.

    The one place where the path of ``path/to/file.py:NAME`` is made absolute; ``~`` is the home
    folder. All other names stay as they are.
    """
    if isinstance(name, Placed):
        return name.place
    place, colon, attribute = name.rpartition(":")
    if not _is_path(place):
        return name
    return f"{Path(os.path.expanduser(place)).absolute()}{colon}{attribute}"


def load(reference: str, name: str, kind: str = "localizer") -> Any:
    """Return what a reference leads to.

    Args:
        reference: ``package.module:NAME`` or ``path/to/file.py:NAME``.
        name: as the user gave it, for the error message.
        kind: of what it names, for the error message.

    Raises:
        InputError: there is no such module, file or attribute, or its code fails while importing.
    """
    named = f"the {kind} {name!r}"
    place, _, attribute = reference.rpartition(":")
    if not place or not all(part.isidentifier() for part in attribute.split(".")):
        raise InputError(
            f"{named} leads to {reference!r}, but must be package.module:NAME or "
            "path/to/file.py:NAME."
        )
    path = Path(os.path.expanduser(place)).absolute() if _is_path(place) else None
    source = b"" if path is None else _source(path, named)
    try:
        with contextlib.chdir(os.curdir):  # comes back, wherever it goes
            module = importlib.import_module(place) if path is None else _run(path, source)
        found: Any = module
        for part in attribute.split("."):
            if not hasattr(found, part):  # a module may run code of its own to find out
                break
            found = getattr(found, part)
        else:
            return found
    except SyntaxError as error:
        raise InputError(
            f"{named} has a syntax error in {error.filename}, line {error.lineno}: {error.msg}."
        ) from error
    except BaseException as error:  # whatever a plug-in raises while importing
        if is_ctrl_c(error):
            raise
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if path is None and missing and f"{place}.".startswith(f"{missing}."):
            raise _no_module(named, missing) from None
        remedy = ""
        beside = path and missing and path.parent / missing.partition(".")[0]
        if path and beside and (beside.is_dir() or beside.with_suffix(".py").is_file()):
            remedy = f": a file stands alone, so make {path.stem} and {missing} a package"
        raise InputError(
            f"{named} cannot be imported: its own code raised {raised(error, str(path))}{remedy}."
        ) from error
    own = _offered(module)
    raise InputError(
        f"{named} does not exist: {place} has no {attribute!r}"
        f"{_nearest(attribute, own)}; it defines {', '.join(own) or 'nothing'}."
    )


def reference_digest(reference: str) -> str | None:
    """SHA-256 of the code behind a reference; see ``digests``. It is read, not run."""
    place = absolute_name(reference).rpartition(":")[0]
    return file_digest(place) if _is_path(place) else module_digest(place)


def raised(error: BaseException, file: str | None = None) -> str:
    """Say what was raised and where: "ValueError: words (name.py, line 7)".

    The line is the deepest one in ``file``, or the deepest of all.
    """
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == file] or frames
    said = reason_of(error).rstrip(".")
    return f"{said} ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else said


def reason_of(error: BaseException) -> str:
    """Return an error in words; of a file whose own processes cannot import it, what to do."""
    shown = "".join(traceback.format_exception(error))  # and what caused it
    if "BrokenProcessPool" not in shown and f"No module named '{_MODULE}" not in shown:
        return in_words(error)
    remedy = "its file.py cannot be imported by processes that it starts, so make it a package"
    return f"{in_words(error).rstrip('.')}: {remedy}"


def _source(path: Path, named: str) -> bytes:
    try:
        return content_of(path)
    except UnreadableError as error:
        raise InputError(f"{named} cannot be read: {path} {error}.") from None
    except FileNotFoundError as error:
        beside = sorted(file.name for file in path.parent.glob("*.py"))
        raise InputError(
            f"{named} cannot be read: {path}: {error.strerror}{_nearest(path.name, beside)}."
        ) from None


def _run(path: Path, source: bytes) -> ModuleType:
    """Run a file as a module of its own, once per content: an edited file is another module."""
    content = hashlib.sha256(b"\0".join((str(path).encode(), source))).hexdigest()
    name = f"{_MODULE}{content[:16]}"
    if name not in sys.modules:
        code = compile(source, str(path), "exec")
        module = ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module  # dataclasses and pickle look a class's module up
        try:
            exec(code, vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _no_module(named: str, missing: str) -> InputError:
    parent, _, last = missing.rpartition(".")
    folders = getattr(sys.modules.get(parent), "__path__", None) if parent else None
    beside = [found.name for found in pkgutil.iter_modules(folders)]
    return InputError(
        f"{named} does not exist: no module is named {missing!r}"
        f"{_nearest(last, beside)}; install it, put its folder on PYTHONPATH, or give the path of "
        "its file as path/to/file.py:NAME."
    )


def _is_path(place: str) -> bool:
    return place.endswith(".py") or "/" in place or "\\" in place


def _offered(module: ModuleType) -> list[str]:
    """Names of the classes and functions that a module defines itself."""
    return [
        name
        for name, value in vars(module).items()
        if callable(value) and getattr(value, "__module__", None) == module.__name__
    ]


def _nearest(name: str, names: Iterable[str]) -> str:
    nearest = difflib.get_close_matches(name, list(names), n=1, cutoff=0.4)
    return f" (did you mean {nearest[0]!r}?)" if nearest else ""
