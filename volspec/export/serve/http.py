"""HTTP of a served scene: who may ask, what they may ask for, and what every answer says.

    browser -> LimitedServer -> [http] -> CastQueue -> SceneViews

Two routes exist: the page, and a view. Everything else is refused with one line of text.
Only `scene_server` imports this module, because it needs tornado.
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

from tornado.ioloop import IOLoop
from tornado.iostream import IOStream
from tornado.web import Application, HTTPError, RequestHandler

from volspec.errors import CastCancelled, InputError, VolspecError, one_line, quote
from volspec.export.page import PageSpec, page_policy
from volspec.export.serve.connections import LimitedServer
from volspec.export.serve.views import CastQueue, PendingCast, SceneViews, ViewRequest
from volspec.raycast.launch import Progress
from volspec.scene import Scene
from volspec.scene.tables import NamedLight
from volspec.volume import Volume

# Names of this machine, also at the near end of a tunnel, whose port may be another one.
_OWN_NAMES = {"localhost", "127.0.0.1", "::1"}
_MAX_WAITING = 1024  # connections that are not accepted yet
_ENTER = "open the address that volspec serve printed last"
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
    host, port, insecure
        As for `scene_server`, and so are the errors.
    """

    def __init__(self, host: str, port: int, insecure: bool = False) -> None:
        self._host, self._socket = host, _listen(host, port, insecure)
        address = self._socket.getsockname()
        self._port: int = address[1]
        self._is_private = _is_loopback(address)
        self._token = secrets.token_urlsafe(24)
        self._ready: Callable[[], object] = lambda: None
        self._queue: CastQueue | None = None
        self._site: _Site | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped = asyncio.Event()

    @property
    def address(self) -> str:
        """Address that opens the page, with a token, which changes once a browser has used it."""
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
        return self._is_private

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
        hosts = {*_OWN_NAMES, self._host.lower(), socket.gethostname().lower()}
        names = None if _is_wildcard(self._host) else frozenset(hosts)
        cookie = f"volspec-{self._port}", secrets.token_urlsafe(24)
        self._site = _Site(html, self._queue, self._use_token, cookie, names)

    def run(self, ready: Callable[[], object] = lambda: None) -> None:
        """Answer requests until `stop` is called or the process is interrupted, then close.

        In a running event loop, as cells of notebooks are, a thread answers while this waits.

        Parameters
        ----------
        ready : function, optional
            Called as soon as requests are answered and an interrupt ends it, and again at every
            new `address`.
        """
        self._ready = ready
        try:
            if not _is_in_loop():
                asyncio.run(self._answer())
                return
            with ThreadPoolExecutor(1) as thread:
                answered = thread.submit(asyncio.run, self._answer())
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

    def _use_token(self, token: bytes) -> bool:
        """Return True for the token of `address`, which then becomes another one."""
        if not _equal(token, self._token):
            return False
        self._token = secrets.token_urlsafe(24)
        with suppress(OSError):  # nobody reads what it prints
            self._ready()
        return True

    async def _answer(self) -> None:
        if self._site is None:
            raise InputError("serve: no scene is open", "call open first", code="state")
        self._loop = asyncio.get_running_loop()
        arguments = {"site": self._site}
        app = Application(
            [("/", _Page, arguments), ("/view", _View, arguments)],
            default_handler_class=_Nothing,
            default_handler_args=arguments,
            log_function=lambda handler: None,
        )
        server = LimitedServer(app)
        app.settings["authenticate"] = server.authenticate
        server.accept_from(self._socket)
        # asyncio's own handler may miss an interrupt that comes just before the loop waits.
        # Windows has no other, and other threads get no signals.
        with suppress(NotImplementedError, RuntimeError, ValueError):
            self._loop.add_signal_handler(signal.SIGINT, self._stopped.set)
        try:
            self._ready()
            await self._stopped.wait()
        finally:
            IOLoop.current().remove_handler(self._socket)
            await server.close_all_connections()


@dataclass(frozen=True, slots=True, eq=False)
class _Site:
    """A page, its casts, and the secrets that its handlers check."""

    html: str
    queue: CastQueue
    use_token: Callable[[bytes], bool]
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
    _is_authenticated = False

    def initialize(self, site: _Site) -> None:
        self.site = site

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        self._require_host()
        if not self._has_cookie():
            raise _Refused(403, f"this page needs a token; {_ENTER}")
        self._authenticate()

    def _has_cookie(self) -> bool:
        name, secret = self.site.cookie
        # A cookie of another server on this machine may hold anything.
        value = self.request.cookies[name].value if name in self.request.cookies else ""
        return _equal(value.encode(), secret)

    def _authenticate(self) -> None:
        self._is_authenticated = True
        self.settings["authenticate"](self._stream)

    @property
    def _stream(self) -> IOStream:
        connection: Any = self.request.connection
        return connection.stream

    def _require_host(self) -> None:
        """Refuse names under which other sites could reach this server [DNS rebinding]."""
        host = self.request.headers.get("Host", "")
        name = None
        with suppress(ValueError):
            name = urlsplit(f"//{host}").hostname
        if self.site.names is not None and name not in self.site.names:
            # Without the known names, as the asking site could read them.
            problem = f"{host!r:.60} is no name of this server"
            raise _Refused(403, f"{problem}; {_ENTER}")

    def compute_etag(self) -> None:
        """None: nothing is stored."""

    def log_exception(self, typ: Any, value: Any, tb: Any) -> None:
        """Log only what is no refusal, as anybody can ask for those."""
        if not isinstance(value, HTTPError):
            super().log_exception(typ, value, tb)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        error = kwargs["exc_info"][1] if "exc_info" in kwargs else None
        if isinstance(error, _Refused):
            text = error.text
        elif status_code == 405:
            self.set_header("Allow", ", ".join(self.SUPPORTED_METHODS))
            text = f"method {self.request.method} is not supported; use GET"
        else:
            text = f"the request failed: {one_line(error or self._reason)}"
        if not self._is_authenticated:
            self.set_header("Connection", "close")
        self.finish(f"{one_line(text)}\n")

    def on_finish(self) -> None:
        if not self._is_authenticated:
            self._stream.close()


class _Nothing(_Guarded):
    """Every other path."""

    def prepare(self) -> None:
        super().prepare()
        raise _Refused(404, "there is nothing here; the page is at /")


class _Page(_Guarded):
    """The page; with the token in its address, the cookie."""

    def prepare(self) -> None:
        tokens = self.request.query_arguments.get("token")
        # Programs that look at links ask for heads, and must not use the token up.
        if tokens is None or self.request.method == "HEAD":
            super().prepare()
            return
        self._require_host()
        if not self._has_cookie():
            if not self.site.use_token(tokens[-1]):
                raise _Refused(403, f"the token is wrong, or was used before; {_ENTER}")
            # Without a path, the cookie is for this one, also behind a proxy that adds to it.
            self.set_cookie(*self.site.cookie, path="", httponly=True, samesite="Strict")
        self._authenticate()
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
        origin, authority = headers.get("Origin"), None
        with suppress(ValueError):
            authority = urlsplit(origin or "").netloc
        if not own_site or (origin and authority != headers.get("Host")):
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


def _equal(value: bytes, secret: str) -> bool:
    """Compare in constant time."""
    return compare_digest(value, secret.encode())


def _is_in_loop() -> bool:
    """Return True in a running event loop."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _is_loopback(address: tuple[Any, ...]) -> bool:
    return ipaddress.ip_address(address[0]).is_loopback


def _is_wildcard(host: str) -> bool:
    """Return True if a host is all addresses of the machine."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_unspecified
    return not host


def _listen(host: str, port: int, insecure: bool) -> socket.socket:
    """Return a socket that listens at an address. Raises InputError if it cannot."""
    if not 0 <= port <= 65535:  # the system would take its lower bits
        raise InputError.refused("port", port, "give 0 to 65535", "range")
    try:
        infos = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        # Of a name's addresses, that of IPv4, which "localhost" means in tunnels.
        family, _, _, _, address = min(infos, key=lambda info: info[0] != socket.AF_INET)
        if not (insecure or _is_loopback(address)):
            tunnel = f"ssh -L {port or 'PORT'}:localhost:{port or 'PORT'} THIS_MACHINE"
            raise InputError(
                f"{quote(host)} lets other machines connect, and the traffic is not encrypted",
                f"leave it out and connect by {tunnel}, or add --insecure (Python: insecure=True)",
                code="conflict",
                field="host",
                given=host,
            )
        listener = socket.create_server(address, family=family, backlog=_MAX_WAITING)
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
    listener.setblocking(False)
    return listener
