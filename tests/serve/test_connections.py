"""Peers without the cookie: they leave room, time and handles to those that have it."""

import errno
import resource
import socket
import subprocess
import sys
from contextlib import ExitStack
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest

from tests.serve.conftest import Client, entered, serving
from tests.support.patience import PATIENCE_S
from volspec.errors import VolspecWarning
from volspec.export.serve import connections

HOST = b" HTTP/1.1\r\nHost: localhost\r\n"
SENT = (
    *(b"", b"G", b"GET /" + HOST, b"GET /" + HOST + b"X: " + b"x" * 60_000, b"\x16\x03\x01" * 99),
    *(b"GET /?token=wrong" + HOST + b"\r\n", 300 * (b"GET /" + HOST + b"\r\n") + b"\0\r\n\r\n"),
    *(b"POST /" + HOST + b"Content-Length: 9\r\n\r\n", b"GET / HTTP/1.1\r\nHost: [\r\n\r\n"),
    b"POST /" + HOST + b"Transfer-Encoding: chunked\r\n\r\n",
    b"GET /" + HOST + b"Content-Type: multipart/form-data; boundary=x\r\n\r\n",
    b"GET /view" + HOST + b"Connection: Upgrade\r\nUpgrade: websocket\r\n",
)


def connect(peers: ExitStack, port: int, data: bytes = b"") -> socket.socket:
    made = peers.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
    made.sendall(data)
    return made


def test_400_connections_without_the_token_leave_256_handles_to_one_with_it(ball_scene):
    command = [sys.executable, "-m", "volspec", "serve", str(ball_scene.path), "--port", "0"]
    limits = 256, resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    given = {"stdout": -1, "stderr": -1, "text": True}
    given["preexec_fn"] = lambda: resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    with ExitStack() as peers, subprocess.Popen(command, **given) as process:
        address = process.stdout.readline().split()[0]
        client = Client(SimpleNamespace(port=urlsplit(address).port, address=address))
        for i in range(400):
            connect(peers, client.server.port, SENT[i % len(SENT)])
        client.enter()
        assert client.view().status == 200
        process.send_signal(2)
        assert process.wait(PATIENCE_S) == 0 and len(process.stderr.readlines()) <= 10


def test_the_oldest_close_for_newer_ones(ball_scene, monkeypatch):
    for name in ("_MAX_OF_PEER", "_MAX_AUTHENTICATED"):
        monkeypatch.setattr(connections, name, 2)
    with entered(ball_scene) as client, ExitStack() as peers:
        for data in (b"", b"GET /" + HOST + f"Cookie: {client.cookie}\r\n\r\n".encode()):
            oldest = connect(peers, client.server.port, data)
            oldest.recv(9 if data else 0)  # it shows the cookie before the others do
            for _ in range(2):
                connect(peers, client.server.port, data).recv(9 if data else 0)
            while oldest.recv(1 << 16):
                pass


def test_connections_close_in_time_unless_they_have_the_cookie(ball_scene, monkeypatch):
    monkeypatch.setattr(connections, "_UNKNOWN_S", 0.1)
    with entered(ball_scene) as client, ExitStack() as peers:
        page = b"HEAD /" + HOST + f"Cookie: {client.cookie}\r\n\r\n".encode()
        known = connect(peers, client.server.port, page)
        assert known.recv(1 << 16).startswith(b"HTTP/1.1 200")
        for _ in range(2):
            assert connect(peers, client.server.port, b"GET").recv(1) == b""
        known.sendall(page)
        assert known.recv(1 << 16).startswith(b"HTTP/1.1 200")


def test_connections_wait_while_there_are_no_handles(ball_scene, monkeypatch):
    left, accept = [errno.EMFILE] * 3, socket.socket.accept

    def exhausted(listening: socket.socket) -> object:
        if left:
            raise OSError(left.pop(), "Too many open files")
        return accept(listening)

    monkeypatch.setattr(connections, "_PAUSE_S", 0.01)
    monkeypatch.setattr(socket.socket, "accept", exhausted)
    with (
        pytest.warns(VolspecWarning, match="Too many open files") as told,
        serving(ball_scene) as s,
    ):
        assert Client(s).enter().status == 303
    assert len(told) == 1 and not left
