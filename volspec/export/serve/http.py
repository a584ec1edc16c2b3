"""HTTP of a served scene: who may ask, what they may ask for, and what every answer says.

    browser -> [http] -> CastQueue -> SceneViews

Two routes exist: the page, and a view. Everything else is refused with one line of text. Only
`scene_server` imports this module, because it needs tornado.
"""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import secrets
import signal
import socket
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from hmac import compare_digest
from typing import Any
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler

from volspec.errors import CastCancelled, InputError, VolspecError, one_line
from volspec.export.page import PageSpec, page_policy
from volspec.export.serve.views import CastQueue, PendingCast, SceneViews, ViewRequest
from volspec.raycast.row_batches import Progress
from volspec.scene import Scene
from volspec.scene.lights import NamedLight
from volspec.volume import Volume

# Names of this machine, also at the near end of a tunnel, whose port may be another one.
_OWN_NAMES = {"localhost", "127.0.0.1", "::1"}
_MAX_HEADER_BYTES, _MAX_BODY_BYTES, _IDLE_S = 16_384, 4096, 600
_HEADERS = {
    "Content-Type": "text/plain; charset=utf-8",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class SceneServer:
    """Server of one scene; made by `volspec.export.serve.scene_server`.

    Parameters
    ----------
    host, port
        As for `scene_server`, and so are the errors.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host, self._socket = host, _listen(host, port)
        self._port: int = self._socket.getsockname()[1]
        self._token = secrets.token_urlsafe(24)
        self._queue: CastQueue | None = None
        self._site: _Site | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped = asyncio.Event()

    @property
    def address(self) -> str:
        """Address that opens the page, with the token."""
        host = socket.gethostname() if _is_wildcard(self._host) else self._host
        name = f"[{host}]" if ":" in host else host
        return f"http://{name}:{self._port}/?token={self._token}"

    @property
    def port(self) -> int:
        """Port that it listens at."""
        return self._port

    @property
    def is_private(self) -> bool:
        """True if only this machine can connect."""
        if self._host.lower() == "localhost":
            return True
        with suppress(ValueError):
            return ipaddress.ip_address(self._host).is_loopback
        return False

    def open(
        self,
        scene: Scene,
        lights: Sequence[NamedLight] | None = None,
        spec: PageSpec | None = None,
        *,
        volume: Volume | None = None,
        size: tuple[int, int] | None = None,
        device: str | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Cast a scene's first picture, and build its page.

        Parameters
        ----------
        scene : Scene
        lights : sequence of NamedLight, optional
            Lights, instead of the scene's; the first is switched on.
        spec : PageSpec, optional
            Title and caption of the page.
        volume, size, device, progress
            As in `Scene.render`.

        Raises
        ------
        VolspecError
            If the scene cannot be cast or shown on a page.
        """
        views = SceneViews(scene, volume, size=size, device=device)
        html = views.page(lights or scene.lights, spec or PageSpec(), progress)
        self._queue = CastQueue(views.message)
        own = {*_OWN_NAMES, self._host.lower(), socket.gethostname().lower()}
        names = None if _is_wildcard(self._host) else frozenset(own)
        cookie = f"volspec-{self._port}", secrets.token_urlsafe(24)
        self._site = _Site(html, self._queue, self._token, cookie, names)

    def run(self, ready: Callable[[], object] = lambda: None) -> None:
        """Answer requests until `stop` is called or the process is interrupted, then close.

        In a running event loop, as cells of notebooks are, a thread answers while this waits.

        Parameters
        ----------
        ready : function, optional
            Called as soon as requests are answered and an interrupt ends it.
        """
        try:
            if not _is_in_loop():
                asyncio.run(self._answer(ready))
                return
            with ThreadPoolExecutor(1) as thread:
                answered = thread.submit(asyncio.run, self._answer(ready))
                try:
                    answered.result()
                except KeyboardInterrupt:
                    self.stop()
        finally:
            self.close()

    def stop(self) -> None:
        """End `run`; may be called from any thread."""
        if self._loop is None:
            self._stopped.set()
            return
        with suppress(RuntimeError):  # it has ended
            self._loop.call_soon_threadsafe(self._stopped.set)

    def close(self) -> None:
        """Cancel casts and close the socket; can be repeated."""
        self._socket.close()
        if self._queue is not None:
            self._queue.close()

    async def _answer(self, ready: Callable[[], object]) -> None:
        if self._site is None:
            raise InputError("serve: no scene is open", "call open first", code="state")
        self._loop = asyncio.get_running_loop()
        given = {"site": self._site}
        app = Application(
            [("/", _Page, given), ("/view", _View, given)],
            default_handler_class=_Nothing,
            default_handler_args=given,
            log_function=lambda handler: None,
        )
        server = HTTPServer(
            app,
            max_header_size=_MAX_HEADER_BYTES,
            max_body_size=_MAX_BODY_BYTES,
            idle_connection_timeout=_IDLE_S,
        )
        server.add_socket(self._socket)
        # asyncio's own handler may miss an interrupt that comes just before the loop waits.
        # Windows has no other, and other threads get no signals.
        with suppress(NotImplementedError, RuntimeError, ValueError):
            self._loop.add_signal_handler(signal.SIGINT, self._stopped.set)
        try:
            ready()
            await self._stopped.wait()
        finally:
            server.stop()
            await server.close_all_connections()


@dataclass(frozen=True, slots=True, eq=False)
class _Site:
    """A page, its casts, and the secrets that its handlers check."""

    html: str
    queue: CastQueue
    token: str
    cookie: tuple[str, str]  # name, which the port makes unique on a machine, and value
    names: frozenset[str] | None  # that a Host header may give; None: any


class _Refused(HTTPError):
    """An answer of one line."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(status)
        self.text = text


class _Guarded(RequestHandler):
    """Handler that answers only requests of this page, with its cookie."""

    SUPPORTED_METHODS = ("GET", "HEAD")

    def initialize(self, site: _Site) -> None:
        self.site = site

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        self._require_host()
        name, secret = self.site.cookie
        # A cookie of another server on this machine may hold anything.
        given = self.request.cookies[name].value if name in self.request.cookies else ""
        if not _equal(given.encode(), secret):
            raise _Refused(
                403, "this page needs a token; open the address that volspec serve printed"
            )

    def _require_host(self) -> None:
        """Refuse names under which other sites could reach this server [DNS rebinding]."""
        host = self.request.headers.get("Host", "")
        name = None
        with suppress(ValueError):
            name = urlsplit(f"//{host}").hostname
        if self.site.names is not None and name not in self.site.names:
            # Without the known names, as the asking site could read them.
            problem = f"{host!r:.60} is no name of this server"
            raise _Refused(403, f"{problem}; open the address that volspec serve printed")

    def compute_etag(self) -> None:
        """None: nothing is stored."""

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        error = kwargs["exc_info"][1] if "exc_info" in kwargs else None
        if isinstance(error, _Refused):
            text = error.text
        elif status_code == 405:
            self.set_header("Allow", ", ".join(self.SUPPORTED_METHODS))
            text = f"method {self.request.method} is not supported; use GET"
        else:
            text = f"the request failed: {one_line(error or self._reason)}"
        self.finish(f"{one_line(text)}\n")


class _Nothing(_Guarded):
    """Every other path."""

    def prepare(self) -> None:
        super().prepare()
        raise _Refused(404, "there is nothing here; the page is at /")


class _Page(_Guarded):
    """The page; with the token in its address, the cookie."""

    def prepare(self) -> None:
        tokens = self.request.query_arguments.get("token")
        if tokens is None:
            super().prepare()
            return
        self._require_host()
        if not _equal(tokens[-1], self.site.token):
            raise _Refused(403, "the token is wrong; open the address that volspec serve printed")
        # Without a path, the cookie is for this one, also behind a proxy that adds to it.
        self.set_cookie(*self.site.cookie, path="", httponly=True, samesite="Strict")
        self.set_status(303)
        self.set_header("Location", "./")
        self.finish()

    def get(self) -> None:
        self.set_header("Content-Type", "text/html; charset=utf-8")
        policy = f"{page_policy(served=True)}; frame-ancestors 'none'"
        self.set_header("Content-Security-Policy", policy)
        self.finish(self.site.html)

    head = get


class _View(_Guarded):
    """A cast, for the page's own script."""

    _pending: PendingCast | None = None

    def prepare(self) -> None:
        super().prepare()
        headers = self.request.headers
        own_site = headers.get("Sec-Fetch-Site", "same-origin") in ("same-origin", "none")
        origin = headers.get("Origin")
        if not own_site or (origin and urlsplit(origin).netloc != headers.get("Host")):
            raise _Refused(403, "another site asked for this view; open the page itself")

    async def get(self) -> None:
        try:
            request = ViewRequest.read(self.request.query_arguments)
        except InputError as error:
            raise _Refused(400, str(error)) from None
        queue = self.site.queue
        self._pending, future = queue.submit(request)
        try:
            message = await asyncio.wrap_future(future)
        except CastCancelled:
            raise _Refused(409, "view: a newer request replaced this one") from None
        except VolspecError as error:
            raise _Refused(422 if isinstance(error, InputError) else 500, str(error)) from None
        except MemoryError:
            raise _Refused(500, "view: no memory for the picture; serve it smaller") from None
        finally:
            queue.done(self._pending)
        self.set_header("Content-Type", "application/octet-stream")
        self.finish(message)

    def on_connection_close(self) -> None:
        if self._pending is not None:
            self._pending.cancel()


def _equal(given: bytes, secret: str) -> bool:
    """Compare in constant time."""
    return compare_digest(given, secret.encode())


def _is_in_loop() -> bool:
    """Return True in a running event loop."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _is_wildcard(host: str) -> bool:
    """Return True if a host is all addresses of the machine."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_unspecified
    return not host


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address. Raises InputError if it cannot."""
    if not 0 <= port <= 65535:  # the system would take its lower bits
        raise InputError.refused("port", port, "give 0 to 65535", "range")
    try:
        found = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        # Of a name's addresses, that of IPv4, which "localhost" means in tunnels.
        family, _, _, _, address = min(found, key=lambda each: each[0] != socket.AF_INET)
        made = socket.create_server(address, family=family)
    except OSError as error:
        if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
            remedy = "give one of this machine's addresses, such as 127.0.0.1"
            raise InputError.refused("host", host, remedy, "not-found") from None
        if error.errno == errno.EACCES:
            remedy = "the system reserves it, give 1024 or more"
            raise InputError.refused("port", port, remedy, "unwritable") from None
        remedy = "another program uses it, give another, or 0 for any that is free"
        if error.errno != errno.EADDRINUSE:
            remedy = f"{one_line(error)}, give another, or 0 for any that is free"
        raise InputError.refused("port", port, remedy, "conflict") from None
    made.setblocking(False)
    return made
