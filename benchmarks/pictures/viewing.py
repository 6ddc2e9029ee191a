"""Where runs are looked at: an MCAP file, a live server, or both; docs/look-at-it.md.

Both are foxglove-sdk's, an optional extra. A server shows a viewer what follows after it has
subscribed; the map is sent again to each.
"""

import math
import os
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from benchmarks.console import Terminated
from benchmarks.files import is_empty
from benchmarks.pictures.messages import Messages
from benchmarks.tables.text import short_names
from benchmarks.trials.episode import Moment
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.files import PREFIX, SUFFIX
from deqmcl_gym.validation import InputError, integer

HOST = "127.0.0.1"
_PACE = 0.1  # s between two steps of a live run, at least
_GRACE = 0.2  # s after a viewer's first subscription in which its others come
_LOOK = 0.05  # s between two looks whether a viewer has come or gone


@dataclass(frozen=True, kw_only=True)
class Views:
    """Where a run is looked at.

    Attributes:
        mcap: a file to write; None: none.
        live: the port of a server on this machine, 0: any that is free; None: no server.
    """

    mcap: Path | None = None
    live: int | None = None

    def check(self) -> None:
        """Refuse what cannot be written or served.

        Raises:
            InputError: foxglove-sdk is not installed, the file has another ending or exists, or
                the number is no port that is free.
        """
        for flag, given in {"--mcap": self.mcap, "--live": self.live}.items():
            if given is not None and find_spec("foxglove") is None:
                raise InputError(
                    f"{flag} needs foxglove-sdk, which is not installed: pip install "
                    "'deqmcl-gym[view]'."
                )
        if self.live is not None:
            integer("--live", self.live, low=0, high=65_535)
            with socket.socket() as tried:
                tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    tried.bind((HOST, self.live))
                except OSError:
                    raise InputError(_taken(self.live)) from None
        if self.mcap is None:
            return
        if self.mcap.suffix.lower() != ".mcap":
            raise InputError(f"--mcap is {self.mcap}, but must end in .mcap.")
        if os.path.lexists(self.mcap):
            raise InputError(f"{self.mcap} exists already: give another --mcap.")

    @contextmanager
    def showing(
        self, runs: Mapping[str, Iterable[Moment]], stage: Stage
    ) -> Iterator[Iterator[tuple[Moment, ...]]]:
        """Yield runs, side by side, that are shown as they go on.

        A live run begins when a viewer has subscribed to something. A file is there whole when the
        runs have ended. At the end of the block the last step is shown until no viewer is left, so
        write inside it what is to be kept.

        Args:
            runs: moments of one world by the name of the localizer.
            stage: of the first of them.

        Raises:
            InputError: a log has times before 0 s, or the port is taken.
        """
        with ExitStack() as stack:
            live: _Live | None = None
            if self.live is not None:
                live = stack.enter_context(_Live(self.live, stage, tuple(runs)))
            yield stack.enter_context(closing(self._shown(runs, stage, live)))

    def _shown(
        self, runs: Mapping[str, Iterable[Moment]], stage: Stage, live: "_Live | None"
    ) -> Generator[tuple[Moment, ...], None, None]:
        """Pass runs on, side by side, and to the file and the server."""
        with ExitStack() as stack:
            writers: list[Callable[[float, Sequence[Moment]], None]] = []
            if self.mcap is not None:
                context = stack.enter_context(_file(self.mcap))
                writers.append(Messages(context, stage, tuple(runs)).write)
            if live is not None:
                writers.append(live.write)
            for moments in zip(*runs.values(), strict=True):
                for write in writers:
                    write(_time(stage, moments[0]), moments)
                yield moments


def check_folder(folder: Path) -> None:
    """Refuse a folder for MCAP files that holds some, or what else there is.

    Raises:
        InputError: foxglove-sdk is not installed, or the folder is not empty.
    """
    Views(mcap=folder / "any.mcap").check()
    if not is_empty(folder) or (folder.exists() and not folder.is_dir()):
        raise InputError(f"--mcap is {folder}, which is there already: give a new folder.")


def shown_again(trials: Sequence[Trial], views: Views) -> None:
    """Run trials on one log or in one world again, side by side, and show them."""
    stages = [Stage.of(trial) for trial in trials]
    short = short_names([trial.localizer for trial in trials])
    runs = {short[stage.trial.localizer]: stage.moments() for stage in stages}
    with views.showing(runs, stages[0]) as rows:
        for _ in rows:
            pass


def _time(stage: Stage, moment: Moment) -> float:
    """Return when a moment is that was just run, s: its record's time, in a room one second a step.

    Raises:
        InputError: it is before 0.
    """
    if not isinstance(stage.room, LogEnv):
        return float(moment.step)
    at = stage.room.record.time
    if at < 0:
        raise InputError(
            f"a record of the log is at {at:g} s, but Foxglove has no time before 0 s: give a log "
            "with later times."
        )
    return at


@contextmanager
def _file(path: Path) -> Iterator[Any]:
    """Yield a context whose messages are in the file when all went well."""
    from foxglove import Context, open_mcap

    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{PREFIX}{secrets.token_hex(4)}{SUFFIX}")
    try:
        with open_mcap(beside, context=(context := Context())):
            yield context
        beside.replace(path)
    finally:
        with suppress(FileNotFoundError):
            beside.unlink()


class _Audience:
    """Who has subscribed to what; foxglove calls it from threads of its own."""

    def __init__(self) -> None:
        self._pairs: set[tuple[int, int]] = set()
        self._changed = threading.Condition()
        self._came = False

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """A viewer wants a channel."""
        with self._changed:
            self._pairs.add((client.id, channel.id))
            self._came = True
            self._changed.notify()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """A viewer does not want it any more, or has left."""
        with self._changed:
            self._pairs.discard((client.id, channel.id))
            self._changed.notify()

    def wait(self, seconds: float | None = None) -> tuple[bool, bool]:
        """Wait for a change; return whether somebody came since the last time, and is there."""
        with self._changed:
            self._changed.wait(seconds)
            came, self._came = self._came, False
            return came, bool(self._pairs)


class _Live:
    """Serves a run on this machine while it is looked at, so fast at most that an eye can follow.

    The server begins after the first step is logged: a viewer that subscribes to a topic in the
    moment in which it is made is refused (foxglove-sdk 0.30).
    """

    def __init__(self, port: int, stage: Stage, names: Sequence[str]) -> None:
        from foxglove import Context

        self._context, self._audience, self._port = Context(), _Audience(), port
        self._messages = Messages(self._context, stage, names)
        self._server: Any = None
        self._last: tuple[float, Sequence[Moment]] | None = None
        self._due = -math.inf

    def __enter__(self) -> Self:
        """Nothing is served yet."""
        return self

    def write(self, at: float, moments: Sequence[Moment]) -> None:
        """Log a step when it is its turn; the first one when somebody looks.

        Raises:
            InputError: the port is taken.
        """
        self._last = at, moments
        came = False
        if self._server is None:
            self._messages.write(at, moments)
            self._begin()
            while not came:
                came, _ = self._audience.wait(_LOOK)
            while self._audience.wait(_GRACE)[0]:
                pass  # a viewer subscribes to several topics at once
        came |= self._audience.wait(0)[0]  # while the step was computed
        while (left := self._due - time.monotonic()) > 0:
            came |= self._audience.wait(left)[0]
        self._due = time.monotonic() + _PACE
        self._messages.write(at, moments, again=came)

    def __exit__(self, failed: type[BaseException] | None, *_: object) -> None:
        """Show the last step until nobody looks any more or Ctrl-C is pressed, if all went well."""
        try:
            if failed is None and self._last is not None:
                _say("the run is over: close the viewer's connection or press Ctrl-C to go on")
                watched = True
                while watched:
                    came, watched = self._audience.wait(_LOOK)
                    if came:
                        self._messages.write(*self._last, again=True)
        except Terminated:
            raise
        except KeyboardInterrupt:  # ends the waiting only: the run is over
            pass
        finally:
            if self._server is not None:
                self._server.stop()

    def _begin(self) -> None:
        from foxglove import start_server

        listener: Any = self._audience  # has only what it listens to
        try:
            self._server = start_server(
                name="deqmcl",
                host=HOST,
                port=self._port,
                server_listener=listener,
                context=self._context,
            )
        except RuntimeError:
            raise InputError(_taken(self._port)) from None
        _say(
            f"waiting for a viewer: open ws://{HOST}:{self._server.port} in Foxglove or Lichtblick"
        )


def _taken(port: int) -> str:
    return f"--live is {port}, a port that is taken or forbidden: give another one, or 0 for any."


def _say(words: str) -> None:
    print(f"deqmcl: {words} …", file=sys.stderr, flush=True)
