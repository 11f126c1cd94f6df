"""The server of the page: on the loopback address alone, for reading alone, of one page and its newest state.

A page of another site cannot read it: names other than this machine's own are refused (a name server may say that any
name is 127.0.0.1), and no answer allows another origin.
"""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any, Final

from analysis.live.state import State, look
from analysis.pages.environment import embedded, page_environment
from analysis.recorded.ctrl_c import awaited
from analysis.recorded.watching import Snapshot, Watch, patiently
from campaigns.version import tool_commit, tool_version
from sim_backend.errors import ConfigError, MccdError

HOST: Final = "127.0.0.1"

HEADERS: Final = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",  # all else is in the page; this is read from here alone
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Server(ThreadingHTTPServer):
    """Answers GET for the page (`/`) and its state (`/state.json`); `state` is what is shown now."""

    daemon_threads = True
    allow_reuse_address = os.name != "nt"  # there it would take a port that another program listens on

    def __init__(self, port: int, state: State, period_s: float) -> None:
        self.state, self.period_s = state, period_s
        self.page = page_environment("analysis.live").get_template("live.html.j2")
        super().__init__((HOST, port), _Answer)
        ending = "" if self.server_port == 80 else f":{self.server_port}"  # browsers leave out the usual one
        self.names = {f"{HOST}{ending}", f"localhost{ending}"}

    def server_bind(self) -> None:
        """Bind the socket; the base class would also ask a name server who we are."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, self.server_address[1]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a reader that went away."""

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.server_port}/"

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return the content type and the content of the page at `path`, None where there is none."""
        if path == "/":
            version = f"{tool_version()} ({tool_commit()})"
            text = self.page.render(state=self.state, period_s=self.period_s, version=version)
            return "text/html; charset=utf-8", text.encode()
        if path == "/state.json":
            return "application/json", embedded(self.state.as_json()).encode()
        return None


class _Answer(BaseHTTPRequestHandler):
    """One request: refused unless it asks for reading, under a name of this machine."""

    server: Server
    timeout = 10.0  # one that says nothing keeps no thread
    server_version, sys_version = "mccd", ""

    def parse_request(self) -> bool:
        """Read the head of a request; False, and answered, for one that is refused."""
        if not super().parse_request():
            return False
        hosts = self.headers.get_all("Host") or []
        if len(hosts) != 1 or hosts[0].lower() not in self.server.names:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST, "this page has another name: use the address as printed")
            return False
        if self.command != "GET":
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED, "this page can be read and nothing else: use GET")
            return False
        return True

    def do_GET(self) -> None:  # noqa: N802 (its name is what is asked for)
        """Answer with the page, its state, or that there is nothing."""
        found = self.server.answer(self.path.partition("?")[0])
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND, f"nothing is here: the page is {self.server.address}")
            return
        kind, content = found
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def end_headers(self) -> None:
        """End the head of any answer with what all have."""
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if self.command != "GET":
            self.send_header("Allow", "GET")
        super().end_headers()

    def log_message(self, *_: Any) -> None:
        """Write nothing: standard error is for remarks."""


def show(watching: Watch, period_s: float, port: int, tell: Callable[[str], None]) -> Snapshot:
    """Show the run in the browser until Ctrl-C and return what was last known of it; `tell` gets the address.

    `port` 0 takes a free one. A replaced log is followed anew; one that can no longer be read is reported on the
    page, and tried again. Raises ConfigError for a port that cannot be had, else as `Watch.look` at the first look.
    """
    seen, state = patiently(lambda: look(watching, time.monotonic()), watching.path)
    with _serving(port, state, period_s) as server:
        with awaited() as ctrl_c_within, suppress(KeyboardInterrupt):
            tell(server.address)
            for newest in _looks(watching, seen, server, lambda: ctrl_c_within(period_s)):
                seen = newest
    return seen


def _looks(watching: Watch, seen: Snapshot, server: Server, enough: Callable[[], bool]) -> Iterator[Snapshot]:
    """Look again until `enough`, and yield what is seen; an ended run is read again only when its file changes."""
    as_ended = None if seen.running else _signature(watching)
    while not enough():
        now = _signature(watching)
        if now is not None and now == as_ended:
            continue
        try:
            seen, server.state = patiently(lambda: look(watching, time.monotonic()), watching.path)
        except MccdError as error:
            server.state, as_ended = server.state.with_trouble(str(error)), None
            continue
        as_ended = None if seen.running else now
        yield seen


def _signature(watching: Watch) -> tuple[int, int, int] | None:
    """Return what changes when a file is written or replaced, None where there is none."""
    try:
        found = watching.path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


@contextmanager
def _serving(port: int, state: State, period_s: float) -> Iterator[Server]:
    try:
        server = Server(port, state, period_s)
    except OSError as error:
        reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be had ({error.strerror})"
        raise ConfigError(
            f"port {port} of {HOST} {reason}: choose another with --port, or none for a free one"
        ) from None
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    with server:
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()
