"""Drag and drop files from another program onto a window: the source side of XDND [1].

    robot -> [dropping] -> X server -> window

References
----------
[1] Lindal, "Drag-and-Drop Protocol for the X Window System", version 5.
    https://www.freedesktop.org/wiki/Specifications/XDND/
"""

import select
from collections.abc import Sequence
from contextlib import closing
from typing import Any

from Xlib import XK, X, Xatom
from Xlib.display import Display
from Xlib.ext import xtest
from Xlib.protocol.event import ClientMessage, SelectionNotify

from tests.support.patience import PATIENCE_S

_VERSION = 5
_STEPS = 4  # of the mouse, from the corner of the screen to the drop


class DropError(Exception):
    """A window refuses the dragged files, or does not answer."""


def drop(
    display: str, window: int, uris: Sequence[str], place: tuple[int, int], key: str = ""
) -> None:
    """Drag files onto a window, let go at a place of the screen, and wait until it has them.

    A key is pressed at the same moment as the window is sent the files' names.

    Raises DropError if the window does not take them, or does not answer.
    """
    with closing(Display(display)) as server:
        source = _Source(server, window, uris, key)
        source.drag(place)
        source.let_go()


class _Source:
    """The source program of a drag: it owns the selection and serves requests for it."""

    def __init__(self, server: Display, window: int, uris: Sequence[str], key: str) -> None:
        self._code = server.keysym_to_keycode(XK.string_to_keysym(key)) if key else 0
        self._server, self._atom = server, server.intern_atom
        self._root = server.screen().root
        self._target = server.create_resource_object("window", window)
        self._own = self._root.create_window(0, 0, 1, 1, 0, X.CopyFromParent)
        # Each line ends so, the last one, too (RFC 2483).
        self._list = "".join(f"{uri}\r\n" for uri in uris).encode("ascii")

    def drag(self, place: tuple[int, int]) -> None:
        """Enter the window and go to a place; the source grabs the mouse until the drop."""
        aware = self._target.get_full_property(self._atom("XdndAware"), Xatom.ATOM)
        if aware is None or aware.value[0] < _VERSION:
            raise DropError(f"window {self._target.id}: takes no drops of XDND {_VERSION}")
        self._own.set_selection_owner(self._atom("XdndSelection"), X.CurrentTime)
        how = X.ButtonReleaseMask, X.GrabModeAsync, X.GrabModeAsync, X.NONE, X.NONE, X.CurrentTime
        self._root.grab_pointer(False, *how)
        self._tell("XdndEnter", _VERSION << 24, self._atom("text/uri-list"))
        copy = self._atom("XdndActionCopy")
        for step in range(1, _STEPS + 1):
            x, y = (round(side * step / _STEPS) for side in place)
            self._root.warp_pointer(x, y)
            self._tell("XdndPosition", 0, x << 16 | y, X.CurrentTime, copy)
            takes = self._answer("XdndStatus")[1] & 1
        if not takes:
            self._tell("XdndLeave")
            raise DropError(f"window {self._target.id}: takes no files at {place}")

    def let_go(self) -> None:
        """Drop the files, send them to the window, and wait until it has them."""
        self._server.ungrab_pointer(X.CurrentTime)
        self._tell("XdndDrop", 0, X.CurrentTime)
        # GLFW 3.4 gives the count of bytes for the one bit that says whether it has them.
        if not self._answer("XdndFinished")[1]:
            raise DropError(f"window {self._target.id}: did not take what was dropped")

    def _tell(self, name: str, *values: int) -> None:
        data = 32, [self._own.id, *values, 0, 0, 0, 0][:5]
        message = ClientMessage(window=self._target, client_type=self._atom(name), data=data)
        self._target.send_event(message)
        self._server.flush()

    def _answer(self, name: str) -> Sequence[int]:
        """Wait for the window's answer to a message; it may request the files before."""
        while True:
            if not self._server.pending_events():
                if not select.select([self._server.fileno()], [], [], PATIENCE_S)[0]:
                    raise DropError(f"window {self._target.id}: no {name}")
                continue
            event = self._server.next_event()
            if event.type == X.SelectionRequest:
                self._give(event)
            elif event.type == X.ClientMessage and event.client_type == self._atom(name):
                return event.data[1]

    def _give(self, request: Any) -> None:
        """Write the files' names to the property that the window names."""
        request.requestor.change_property(request.property, request.target, 8, self._list)
        names = "time", "requestor", "selection", "target", "property"
        request.requestor.send_event(SelectionNotify(**{n: getattr(request, n) for n in names}))
        for event in (X.KeyPress, X.KeyRelease) if self._code else ():
            xtest.fake_input(self._server, event, self._code)
        self._server.flush()
