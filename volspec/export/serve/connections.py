"""Connections of a served scene: how many there are, and how long without its cookie.

    browser -> [connections] -> http

No peer without the cookie can use up the process's file handles, time or log.
"""

from __future__ import annotations

import errno
import socket
import warnings
from typing import Any

from tornado.http1connection import HTTP1ServerConnection
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPConnection, HTTPInputError, HTTPMessageDelegate
from tornado.ioloop import IOLoop
from tornado.iostream import IOStream

from volspec.errors import VolspecWarning, one_line

_LIMITS = {
    "max_header_size": 16_384,
    "max_body_size": 0,
    "body_timeout": 1,
    "idle_connection_timeout": 600,
}
# A connection without the cookie or the token is closed after this time; beyond these numbers, the
# oldest of its peer, or of all, closes for a newer one.
_UNKNOWN_S, _MAX_UNKNOWN, _MAX_OF_PEER, _MAX_AUTHENTICATED = 5, 48, 16, 64
# Accepted at once: fewer, so that what they sent is read before newer ones make them the oldest.
_MAX_ACCEPTED = 8
_EXHAUSTED, _PAUSE_S = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM), 1


class LimitedServer(HTTPServer):
    """HTTP server of an application that calls `authenticate` for those who may stay."""

    def initialize(self, *args: Any, **options: Any) -> None:
        super().initialize(*args, **options | _LIMITS)
        self._unknown: dict[IOStream, tuple[str, object]] = {}  # peer, and timeout
        self._authenticated: dict[IOStream, None] = {}
        self._warned = False

    def accept_from(self, listening: socket.socket) -> None:
        """Accept connections from now on."""
        IOLoop.current().add_handler(listening, self._accept, IOLoop.READ)

    def _accept(self, listening: socket.socket, _: int) -> None:
        try:
            for _ in range(_MAX_ACCEPTED):
                connection, address = listening.accept()
                self.handle_stream(IOStream(connection), address)
        except OSError as error:
            if error.errno in _EXHAUSTED:  # the connection stays in the queue
                self._make_room(listening, error)

    def _make_room(self, listening: socket.socket, error: OSError) -> None:
        """Close the oldest connection without the cookie; if there is none, accept none for now."""
        if self._unknown:
            self._close(next(iter(self._unknown)))
        else:
            loop = IOLoop.current()
            loop.remove_handler(listening)
            loop.call_later(_PAUSE_S, self.accept_from, listening)
        if not self._warned:
            self._warned = True
            warnings.warn(
                f"serve: no connection can be accepted ({one_line(error)}), and some have to wait; "
                "raise the limit of open files (ulimit -n 1024)",
                VolspecWarning,
                stacklevel=2,
            )

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        """Serve a connection, for which an older one may have to close."""
        peer = address[0]
        same = [s for s, (other, _) in self._unknown.items() if other == peer]
        if len(same) >= _MAX_OF_PEER:
            self._close(same[0])
        elif len(self._unknown) >= _MAX_UNKNOWN:
            self._close(next(iter(self._unknown)))
        timeout = IOLoop.current().call_later(_UNKNOWN_S, self._close, stream)
        self._unknown[stream] = peer, timeout
        super().handle_stream(stream, address)

    def start_request(
        self, server_conn: object, request_conn: HTTPConnection
    ) -> HTTPMessageDelegate:
        """Return what answers a request; requests that came before a close are left unread."""
        assert isinstance(server_conn, HTTP1ServerConnection)
        if server_conn.stream.closed():
            return _Closed()
        return super().start_request(server_conn, request_conn)

    def authenticate(self, stream: IOStream) -> None:
        """Let a connection stay that has shown the cookie or the token."""
        if stream in self._unknown:
            self._forget(stream)
            self._authenticated[stream] = None
            if len(self._authenticated) > _MAX_AUTHENTICATED:
                self._close(next(iter(self._authenticated)))

    def on_close(self, server_conn: object) -> None:
        """Forget a connection."""
        super().on_close(server_conn)
        assert isinstance(server_conn, HTTP1ServerConnection)
        self._forget(server_conn.stream)

    def _close(self, stream: IOStream) -> None:
        self._forget(stream)
        stream.close()

    def _forget(self, stream: IOStream) -> None:
        if stream in self._unknown:
            IOLoop.current().remove_timeout(self._unknown.pop(stream)[1])
        self._authenticated.pop(stream, None)


class _Closed(HTTPMessageDelegate):
    """Ends a connection at its next request."""

    def headers_received(self, *_: object) -> None:
        raise HTTPInputError("the connection is closed")
