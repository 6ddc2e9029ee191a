"""``--live``: what a viewer receives, by the websocket client of tornado; when a run goes on."""

import asyncio
import json
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from deqmcl_command import exit_code
from hall import recorded_in_a_hall, write_lap
from refusals import refused
from tornado.websocket import websocket_connect

from benchmarks.console import Terminated
from benchmarks.pictures import viewing
from benchmarks.pictures.viewing import Views

PROTOCOL = "foxglove.sdk.v1"
SECONDS = 120  # for a viewer to give up: a bound, not a measurement
DATA = 1  # a message of a channel: opcode, subscription (4 bytes), time (8), content


@dataclass
class Viewer:
    """What a viewer has been told."""

    channels: dict = field(default_factory=dict)  # by topic
    messages: list = field(default_factory=list)  # (topic, time s, content), in their order

    def topics(self):
        return {topic for topic, _, _ in self.messages}


async def looked(port, wanted, enough):
    """Connect, subscribe to what is wanted when it is advertised, read until it is enough."""
    found, names = Viewer(), {}
    client = await websocket_connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL])
    try:
        assert client.selected_subprotocol == PROTOCOL
        while not enough(found):
            content = await client.read_message()
            assert content is not None, "the server has left"
            if isinstance(content, str):
                told = json.loads(content)
                new = {one["topic"]: one for one in told.get("channels", ())}
                found.channels |= new
                names |= {one["id"]: topic for topic, one in new.items()}
                asked = [{"id": one["id"], "channelId": one["id"]} for topic, one in new.items()
                         if topic in wanted]  # fmt: skip
                if asked:
                    wish = {"op": "subscribe", "subscriptions": asked}
                    await client.write_message(json.dumps(wish))
            elif content[0] == DATA:
                number, time = struct.unpack_from("<IQ", content, 1)
                found.messages.append((names[number], time / 1e9, content[13:]))
        return found
    finally:
        client.close()


def watch(port, wanted, enough):
    return asyncio.run(asyncio.wait_for(looked(port, wanted, enough), SECONDS))


def _hear_ctrl_c():
    """A shell's background jobs ignore it, and so would what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def begun(tmp_path):
    """A function that starts a command with ``--live 0`` and returns it and its port."""
    started = []

    def start(*words):
        write_lap(recorded_in_a_hall(steps=12), tmp_path)
        command = [sys.executable, "-m", "benchmarks", *words, "--live", "0"]
        process = subprocess.Popen(
            command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=_hear_ctrl_c,  # noqa: PLW1509 (it does no more than set a signal)
        )  # fmt: skip
        started.append(process)
        for line in process.stderr:
            if port := re.search(r"ws://127\.0\.0\.1:(\d+)", line):
                return process, int(port[1])
        pytest.fail(f"no server: {process.communicate()}")

    yield start
    for process in started:
        process.kill()
        process.communicate()


REPLAY = (
    *("replay", "lap.csv", "--map", "hall.yaml", "--reference", "lap.tum", "--scan", "power=0.5"),
    *("--localizers", "mcl", "--particles", "50", "--seeds", "1", "--jobs", "1"),
    *("--every", "0.1m,5deg", "--out", "out"),
)


def test_a_viewer_is_told_all_topics_and_gets_the_map_and_every_step_of_the_run(begun, tmp_path):
    process, port = begun(*REPLAY)
    track = np.loadtxt(tmp_path / "out/tracks/mcl-0.tum")
    last = track[-1, 0]
    wanted = {"/map", "/mcl/series"}
    first = watch(
        port,
        wanted,
        lambda seen: any(t == "/mcl/series" and at >= last for t, at, _ in seen.messages),
    )
    assert {"/map", "/tf", "/truth", "/scan", "/mcl/estimate", "/mcl/cloud"} < set(first.channels)
    assert first.channels["/mcl/cloud"]["schemaName"] == "foxglove.PointCloud"
    assert first.topics() == wanted
    series = [
        (at, json.loads(data)) for topic, at, data in first.messages if topic == "/mcl/series"
    ]
    assert [at for at, _ in series] == pytest.approx(track[:, 0].tolist())
    assert [one["step"] for _, one in series] == list(range(len(track)))
    out, err = process.communicate(timeout=SECONDS)
    assert process.returncode == 0, err
    assert "Written to out" in out


def test_who_comes_later_gets_the_map_too_and_the_run_goes_on_until_nobody_looks(begun, tmp_path):
    process, port = begun(*REPLAY)

    async def both():
        begun = asyncio.Event()

        def forever(seen):
            if "/mcl/series" in seen.topics():
                begun.set()
            return False

        early = asyncio.create_task(looked(port, {"/mcl/series", "/tf"}, forever))
        await begun.wait()
        late = await looked(port, {"/map"}, lambda seen: bool(seen.messages))
        assert process.poll() is None
        early.cancel()
        await asyncio.wait([early])
        return late

    late = asyncio.run(asyncio.wait_for(both(), SECONDS))
    ((topic, _, data),) = late.messages
    assert topic == "/map"
    assert len(data) > 1000  # the cells of the hall
    process.communicate(timeout=SECONDS)
    assert process.returncode == 0


def test_ctrl_c_while_the_last_step_is_shown_ends_only_the_waiting(begun, tmp_path):
    process, port = begun(*REPLAY, "--mcap", "a.mcap")

    def over():
        assert any("the run is over" in line for line in process.stderr)

    async def stopped():
        looking = asyncio.create_task(looked(port, {"/mcl/series"}, lambda _: False))
        await asyncio.to_thread(over)
        whole = (tmp_path / "a.mcap").exists()
        process.send_signal(signal.SIGINT)
        await asyncio.gather(looking, return_exceptions=True)  # until the server leaves
        return whole

    patience = threading.Timer(SECONDS, process.kill)
    patience.start()
    assert asyncio.run(stopped())
    out, err = process.communicate(timeout=SECONDS)
    patience.cancel()
    assert process.returncode == 0, err
    assert "MCAP, the first run of each: a.mcap" in out
    assert (tmp_path / "a.mcap").exists()


class Server:
    """Serves nobody."""

    port = 8765

    def stop(self):
        """Nothing is to be stopped."""


@pytest.fixture
def listening(monkeypatch):
    """Listeners of servers that serve nobody, each told that a viewer looks at something."""
    listeners = []

    def start_server(*, server_listener, **_):
        server_listener.on_subscribe(SimpleNamespace(id=1), SimpleNamespace(id=1))
        listeners.append(server_listener)
        return Server()

    monkeypatch.setattr("foxglove.start_server", start_server)
    return listeners


def test_who_comes_while_a_step_takes_long_gets_the_map_with_it(monkeypatch, listening):
    maps = []

    class Kept:
        def __init__(self, *_): ...

        def write(self, at, moments, *, again=False):
            maps.append(again)

    monkeypatch.setattr(viewing, "Messages", Kept)
    live = viewing._Live(0, None, ("mcl",))
    live.write(0.0, ())  # for the server, and again for the first viewer
    for step in (1.0, 2.0):
        time.sleep(2 * viewing._PACE)
        if step == 1.0:
            listening[0].on_subscribe(SimpleNamespace(id=2), SimpleNamespace(id=1))
        live.write(step, ())
    assert maps == [False, True, True, False]


@pytest.mark.parametrize(("how", "code"), [(KeyboardInterrupt, 0), (Terminated, 143)])
def test_all_files_of_a_run_are_written_before_its_viewer_is_waited_for(
    tmp_path, monkeypatch, capsys, listening, how, code
):
    there = set()

    def say(words):
        if words.startswith("the run is over"):
            there.update(path.name for path in tmp_path.rglob("*"))
            raise how

    monkeypatch.setattr(viewing, "_say", say)
    monkeypatch.setattr(viewing, "_PACE", 0.0)
    words = ("run", "--scenario", "guided", "--localizer", "mcl", "--particles", "20")
    words += ("--live", "0", "--mcap", tmp_path / "a.mcap", "--log", tmp_path / "lap.csv")
    assert exit_code(*words, "--out", tmp_path / "out") == code
    files = {"lap.webp", "error.png", "error.csv", "trace.npz", "trajectory_t.tum"}
    assert there >= {"a.mcap", "lap.csv", *files}
    assert ("Written to" in capsys.readouterr().out) == (code == 0)


def test_a_taken_port_and_what_is_none_are_refused(tmp_path, monkeypatch, capsys):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        with refused(f"--live is {taken}", "taken"):
            Views(live=taken).check()
        words = ("run", "--localizer", "mcl", "--live", str(taken), "--out", tmp_path / "o")
        assert exit_code(*words) == 2
        assert f"--live is {taken}" in capsys.readouterr().err
        assert not (tmp_path / "o").exists()
    with refused("--live", "65,535"):
        Views(live=70_000).check()
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with refused("--live needs foxglove-sdk", "pip install 'deqmcl-gym[view]'"):
        Views(live=0).check()
