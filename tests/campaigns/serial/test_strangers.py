"""Connections that a bench cannot trust: idle, half-open, dripping, flooding, or a web page's. ABORt gets through."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from campaigns.serial import SerialBench, ServeOptions, TcpTransport, transport_at
from campaigns.serial import server as serving
from campaigns.serial.addresses import resolved
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import encode_line
from campaigns.serial.ports import TcpPort
from campaigns.serial.serve import serve as run
from campaigns.serial.server import MAX_HOSTS, MAX_WAITING, REMARKS, Server
from campaigns.serial.shared_token import TOKEN, TOKEN_FILE
from sim_backend.bench import Record, Segment
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.simbench import SimBench
from tests.campaigns.serial.conftest import Serve, Served, noise_segment
from tests.campaigns.serial.test_interrupts import wait_until
from tests.small_bench import bench_model

ABORT_S = 1.0
"""As the protocol's document promises."""

SECRET = "0123456789abcdef0123456789abcdef"
WEB_PAGE = "POST / HTTP/1.1\r\nHost: x\r\nContent-Type: text/plain\r\n\r\n"


class Line:
    """A connection made by hand."""

    def __init__(self, address: str, said: bytes = b"") -> None:
        host, _, port = address.removeprefix("tcp:").rpartition(":")
        self.socket = socket.create_connection((host.strip("[]"), int(port)), 5.0)
        self.say(said)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def say(self, said: bytes) -> None:
        self.socket.sendall(said)

    def heard(self, within_s: float = 2.0) -> bytes | None:
        """Return what comes next, nothing when nothing comes, None when the bench has hung up."""
        self.socket.settimeout(within_s)
        try:
            return self.socket.recv(4096) or None
        except TimeoutError:
            return b""
        except OSError:
            return None


def abort(address: str) -> float:
    """Stop the bench over a new connection; return how long that took."""
    started_s = time.monotonic()
    with Line(address, b"ABORt\n") as line:
        answer = line.heard(10.0)
    assert answer is not None and answer.startswith(b"\nOK ")
    return time.monotonic() - started_s


@contextlib.contextmanager
def in_thread(token: bytes | None = None) -> Iterator[tuple[str, list[str], Firmware]]:
    """Serve from a thread, so that a test may set the times; yield address, remarks and firmware."""
    firmware, remarks = Firmware(SimBench(bench_model(), 1), itertools.count(1)), list[str]()
    port = TcpPort(resolved("127.0.0.1", 0)[0])
    server = Server(firmware, port, token=token, remark=remarks.append)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield port.address, remarks, firmware
    finally:
        server.stop()
        thread.join()


@contextlib.contextmanager
def again_and_again(act: Callable[[], object], every_s: float) -> Iterator[None]:
    """Do something beside the test until it is over, whatever comes of it."""
    over = threading.Event()

    def work() -> None:
        while not over.wait(every_s):
            with contextlib.suppress(OSError):
                act()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def bench_at(address: str) -> SerialBench:
    return SerialBench(transport_at("tcp", address.removeprefix("tcp:")), "tcp")


@contextlib.contextmanager
def long_run(served: Served) -> Iterator[list[str]]:
    """Play a minute in real time on a connection of its own; yield what becomes of it."""
    ended: list[str] = []
    bench = bench_at(served.address)

    def play() -> None:
        try:
            bench.play(noise_segment("long", 600_000))
        except HardwareError as error:
            ended.append(str(error))

    thread = threading.Thread(target=play)
    thread.start()
    try:
        assert wait_until(lambda: served.state == "running", 30.0)
        yield ended
    finally:
        bench.safe()
        thread.join()
        bench.close()


def test_an_abort_gets_through_while_idle_lines_fill_the_bench(serve: Serve) -> None:
    served = serve(transport="tcp", speed=1.0)
    with long_run(served) as ended, contextlib.ExitStack() as stack:
        for said in (b"", b"*ID", b"*IDN?\n", b"*IDN?\nSTA"):
            for _ in range(MAX_HOSTS + MAX_WAITING + 2):
                stack.enter_context(Line(served.address, said))
        time.sleep(0.2)
        assert not ended  # whoever plays keeps its place, though the others came later
        assert abort(served.address) < ABORT_S
        assert wait_until(lambda: bool(ended), 2.0) and "safe state" in ended[0]
    assert served.state == "idle"


def test_an_abort_gets_through_beside_lines_that_drip_and_flood(serve: Serve) -> None:
    served = serve(transport="tcp", speed=1.0)

    def drip() -> None:
        for line in (silent, greeted):
            line.say(b"\n")

    with (
        long_run(served),
        Line(served.address, b"*IDN?\n") as flooding,
        Line(served.address) as silent,
        Line(served.address, b"*IDN?\n") as greeted,
        again_and_again(drip, 0.05),
        again_and_again(lambda: flooding.say(b"STAT?\n" * 20_000 + b"\n" * 100_000), 0.0),
    ):
        time.sleep(0.3)
        taken_s = [abort(served.address) for _ in range(3)]
        # who is kept out is kept out each time; a single one may wait for this process, which is what floods
        assert min(taken_s) < ABORT_S and max(taken_s) < 5.0 * ABORT_S
        flooding.socket.shutdown(socket.SHUT_RDWR)


def test_a_newcomer_need_not_wait_for_what_a_bench_computes() -> None:
    """An aborted segment is computed to its end all the same; the next one waits for that, an ABORt does not."""

    class Slow(SimBench):
        def play(self, segment: Segment) -> Record:
            time.sleep(1.0)
            return super().play(segment)

    firmware = Firmware(Slow(bench_model(), 1), itertools.count(1))
    port = TcpPort(resolved("127.0.0.1", 0)[0])
    server = Server(firmware, port)
    thread = threading.Thread(target=server.run)
    thread.start()
    played: list[object] = []
    try:
        bench = bench_at(port.address)
        first = threading.Thread(target=lambda: pytest.raises(HardwareError, bench.play, noise_segment("a", 10)))
        first.start()
        time.sleep(0.3)
        abort(port.address)
        first.join()
        bench.safe()
        second = threading.Thread(target=lambda: played.append(bench.play(noise_segment("b", 10))))
        second.start()
        time.sleep(0.2)
        started_s = time.monotonic()
        with Line(port.address, b"*IDN?\n") as line:
            assert line.heard() and time.monotonic() - started_s < 0.5
        second.join()
        assert len(played) == 1
        bench.close()
    finally:
        server.stop()
        thread.join()


@pytest.mark.parametrize("begins", [WEB_PAGE, "ABOR / HTTP/1.1\r\n\r\n", "GET /*IDN? HTTP/1.1\r\n", "STAT?\n"])
def test_what_does_not_greet_is_hung_up_and_nothing_of_it_carried_out(serve: Serve, begins: str) -> None:
    served = serve(transport="tcp")
    with contextlib.closing(bench_at(served.address)) as bench:
        bench.play(noise_segment("a", 10))
        with Line(served.address, f"{begins}ABORt\r\n*IDN?\r\n".encode()) as line:
            assert line.heard() is None
        assert served.state == "done"  # an ABORt would have made it idle
        told = [entry for entry in served.journal if entry.startswith("refused")]
        assert len(told) == 1 and "is not a greeting" in told[0] and "nothing of it was carried out" in told[0]
        bench.play(noise_segment("b", 10))


@pytest.mark.parametrize("said", [b"", b"*ID", b"\n"])
def test_a_greeting_has_its_time_whatever_drips_in(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    monkeypatch.setattr(serving, "GREET_S", 0.5)
    with in_thread() as (address, remarks, _), Line(address, said) as line:
        started_s = time.monotonic()
        with again_and_again(lambda: line.say(b"\n" if said != b"*ID" else b" "), 0.1):
            assert line.heard(3.0) is None
        assert 0.3 < time.monotonic() - started_s < 1.5
        assert "within 0.5 s; hung up" in remarks[0]


def test_a_silent_host_is_hung_up_unless_it_holds_the_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "IDLE_S", 0.5)
    with in_thread() as (address, remarks, firmware), contextlib.closing(bench_at(address)) as bench:
        with Line(address, b"*IDN?\n") as line:
            assert line.heard()
            with again_and_again(lambda: line.say(b"x"), 0.1):  # bytes that become no command are no sign of life
                assert line.heard(3.0) is None
        assert "silent for 0.5 s" in remarks[0]
        retries = bench.retries
        assert bench.status().state.value == "idle" and firmware.owner is not None
        assert bench.retries == retries  # its line was not touched


def test_the_lock_survives_more_hosts_than_there_are_places() -> None:
    with in_thread() as (address, _, _), contextlib.closing(bench_at(address)) as bench:
        with contextlib.ExitStack() as stack:
            lines = []
            for _ in range(3 * MAX_HOSTS):
                lines.append(stack.enter_context(Line(address, b"*IDN?\n")))
                assert lines[-1].heard()  # each is served when it comes
            bench.status()
            assert bench.retries == 0
            for line in lines[:-MAX_HOSTS]:
                assert line.heard() is None  # those that have been silent longest made room
            assert lines[-1].heard(0.1) == b""


def test_many_who_lock_by_one_name_have_one_place_among_them() -> None:
    """A host that lost its line locks again by its name; no reason to keep as many lines as there are numbers."""
    with in_thread() as (address, _, firmware), contextlib.ExitStack() as stack:
        lines = []
        for _ in range(3 * MAX_HOSTS):
            lines.append(stack.enter_context(Line(address, encode_line("*IDN?", 1) + encode_line("SYST:LOCK me", 2))))
            assert lines[-1].heard()
        assert wait_until(lambda: sum(map(is_open, lines)) <= MAX_HOSTS, 3.0)
        assert is_open(lines[-1]) and firmware.owner == "me"
        assert abort(address) < ABORT_S


def is_open(line: Line) -> bool:
    """Tell whether the bench has not hung up, whatever it said before."""
    while said := line.heard(0.05):
        pass
    return said is not None


def test_strangers_cannot_fill_the_journal() -> None:
    with in_thread() as (address, remarks, _):
        for _ in range(3 * REMARKS):
            with Line(address, b"\xff\n") as line:
                assert line.heard() is None
        assert REMARKS <= len(remarks) < 2 * REMARKS
        assert "begins with '\\\\xff'" in remarks[0]


def remote(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """Return options for a bench behind a token, which stands in a file."""
    path = tmp_path / "token"
    path.write_text(f"{SECRET}\n")
    path.chmod(0o600)
    monkeypatch.delenv(TOKEN, raising=False)
    monkeypatch.delenv(TOKEN_FILE, raising=False)
    return {"transport": "tcp", "host": "0.0.0.0", "allow_remote": True, "token_file": str(path)}


def test_a_bench_for_other_machines_asks_for_its_token(
    serve: Serve, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served = serve(**remote(tmp_path, monkeypatch))
    address = served.address.replace("0.0.0.0", "127.0.0.1")
    assert "whoever shows the token may drive this bench" in served.journal[-1] and SECRET not in served.journal[-1]
    with pytest.raises(HardwareError, match="this bench asks for its token; set MCCD_BENCH_TOKEN"):
        bench_at(address)
    monkeypatch.setenv(TOKEN, "another token, as long as the right one")
    with pytest.raises(HardwareError, match="the token is wrong"):
        bench_at(address)
    assert any("a wrong token was shown" in entry for entry in served.journal)
    monkeypatch.setenv(TOKEN, SECRET)
    with contextlib.closing(bench_at(address)) as bench:
        bench.play(noise_segment("a", 10))
        assert served.state == "done"
        monkeypatch.delenv(TOKEN)
        assert abort(address) < ABORT_S  # whoever comes may stop it
        assert served.state == "idle"


def test_a_host_with_a_token_for_another_bench(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    served = serve(transport="tcp")
    monkeypatch.setenv(TOKEN, SECRET)
    with contextlib.closing(bench_at(served.address)) as bench:
        bench.play(noise_segment("a", 10))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"allow_remote": False}, "other machines could drive this bench; give --allow-remote and a token"),
        ({"token_file": None}, "--allow-remote: there is no token"),
        ({"host": "a..b"}, "host 'a..b': no address can be found"),
        ({"host": ""}, "host '': no address can be found"),
        ({"host": "x" * 70}, "no address can be found"),
        ({"host": "no-such-host.invalid"}, "host 'no-such-host.invalid': no address can be found"),
    ],
)
def test_a_bench_is_not_opened_to_others_by_mistake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, object], message: str
) -> None:
    asked = ServeOptions(**{**remote(tmp_path, monkeypatch), **options})  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=message):
        run(asked, lambda *_: pytest.fail("the bench was opened"), print, print)


@pytest.mark.parametrize("kind", ["short", "open to others", "a pipe", "a folder", "not there", "no ASCII", "huge"])
def test_a_token_that_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    path = tmp_path / "token"
    if kind == "a pipe":
        os.mkfifo(path, 0o600)
    elif kind == "a folder":
        path.mkdir(0o700)
    elif kind != "not there":
        content = {"short": b"secret", "no ASCII": b"\xff" * 40, "huge": b"x" * 10**6}
        path.write_bytes(content.get(kind, SECRET.encode()))
        path.chmod(0o644 if kind == "open to others" else 0o600)
    monkeypatch.delenv(TOKEN, raising=False)
    monkeypatch.setenv(TOKEN_FILE, str(path))
    with pytest.raises(ConfigError, match="token"):
        transport_at("tcp", "127.0.0.1:5025")


def test_ipv6_with_brackets_and_without(serve: Serve) -> None:
    try:
        served = serve(transport="tcp", host="[::1]")
    except HardwareError as error:
        pytest.skip(f"no IPv6 here: {error}")
    assert served.address.startswith("tcp:[::1]:")
    with contextlib.closing(bench_at(served.address)) as bench:
        bench.play(noise_segment("a", 10))
    port = int(served.address.rpartition(":")[2])
    with contextlib.closing(SerialBench(TcpTransport("::1", port), "tcp")) as bench:
        assert np.isfinite(bench.limits.current_a)
