"""Views of a scene from any camera, coarse or whole, as messages for its page.

    ViewRequest -> [views] -> raycast -> pack_view -> message -> web/camera.js

Casts run in one thread, as there is one device. Of each page's requests only the newest counts.
"""

from __future__ import annotations

import json
import math
import struct
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from threading import Event
from typing import Any, Self

import numpy as np

from volspec._checks import checked_size
from volspec.camera import Camera, Orbit, level_axes, radius_mm
from volspec.errors import CastCancelled, InputError, quote
from volspec.export.annotate import annotation_svg
from volspec.export.page import (
    PageSpec,
    PageView,
    ServedCamera,
    pack_view,
    page_html,
    scene_bars,
)
from volspec.image import CoefficientImage
from volspec.pipeline import GAPS, Raycaster, raycast
from volspec.raycast import WHOLE, Pace, Pass
from volspec.raycast.launch import Cancel, Progress
from volspec.scene import Scene
from volspec.scene.tables import NamedLight
from volspec.volume import Volume

DISTANCES = (0.125, 8.0)
"""Least and greatest distance of a camera, as factors of the scene's."""
_RANGES = {
    "azimuth": (-360.0, 360.0),
    "elevation": (-90.0, 90.0),
    "distance": DISTANCES,
    "coarse": (0, 1),
    "transfer": (0, 60_000),
    "client": (0, 2**32 - 1),
}


@dataclass(frozen=True, slots=True)
class ViewRequest:
    """A picture that a page asks for.

    Parameters
    ----------
    azimuth_deg, elevation_deg : float
        Direction of the camera, as in `Orbit`.
    distance : float
        Factor of the distance of the scene's camera.
    coarse : bool
        True while the camera moves.
    transfer_ms : int
        Time that the bytes of the page's last coarse picture took, without the wait for its cast.
    client : int
        Number that the page chose for itself.
    """

    azimuth_deg: float
    elevation_deg: float
    distance: float = 1.0
    coarse: bool = False
    transfer_ms: int = 0
    client: int = 0

    @classmethod
    def read(cls, query: Mapping[str, Sequence[bytes]]) -> Self:
        """Read the arguments of a query.

        Raises InputError if one is missing, unknown, repeated, or out of range.
        """
        if unknown := next((name for name in query if name not in _RANGES), None):
            problem = f"no parameter {quote(unknown)}"
            raise InputError(problem, f"known: {', '.join(_RANGES)}", code="unknown", field="view")
        azimuth, elevation, distance, coarse, transfer, client = (
            _number(name, query.get(name, ()), *limits) for name, limits in _RANGES.items()
        )
        return cls(azimuth, elevation, distance, bool(coarse), int(transfer), int(client))


def _number(name: str, words: Sequence[bytes], low: float, high: float) -> float:
    """Return the number that a query gives once, within limits, whole if they are."""
    kind = type(low)
    try:
        [word] = words
        value = kind(word)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        text = ", ".join(word.decode("ascii", "replace") for word in words)
        noun = "whole number" if kind is int else "number"
        remedy = f"give one {noun} from {low:g} to {high:g}"
        raise InputError.refused(f"view: {name}", text, remedy, "range")
    return value


class SceneViews:
    """A scene on its device, from any camera around it; raises VolspecError if it cannot be cast.

    Parameters
    ----------
    scene : Scene
    volume : Volume, optional
        The scene's, if already loaded.
    size : (width, height), optional
        Pixels of whole pictures, instead of the scene's.
    device : str, optional
        See `volspec.raycast`.
    """

    def __init__(
        self,
        scene: Scene,
        volume: Volume | None = None,
        *,
        size: tuple[int, int] | None = None,
        device: str | None = None,
    ) -> None:
        self.scene, self.volume = scene, volume or scene.volume()
        self.size = checked_size(size or (scene.file.output.width, scene.file.output.height))
        self.orbit = scene_orbit(scene, self.volume)
        self._surfaces = scene.behind(self.volume)
        self._caster = Raycaster(self.volume, device=device)
        self._pace = Pace()

    def page(
        self, lights: Sequence[NamedLight], spec: PageSpec, progress: Progress | None = None
    ) -> str:
        """Cast a coarse picture from the scene's camera, and build the page that opens with it."""
        # Its time includes the kernel's build, and does not count for the pace.
        first, orbit = self._moving, self.orbit
        camera = orbit.camera(self.volume)
        image = self._cast(camera, first, progress=progress)
        served = ServedCamera(
            orbit.azimuth_deg,
            orbit.elevation_deg,
            DISTANCES,
            self.size,
            first != WHOLE,
            image.notes.get(GAPS, ""),
        )
        bars = scene_bars(self.scene, self.volume)
        view = PageView(image, marks=self._marks(camera), values=bars)
        return page_html([view], lights, self.scene.relight, spec, served)

    def message(self, request: ViewRequest, cancel: Cancel | None = None) -> bytes:
        """Cast a view; return its numbers as JSON, after their length in 4 bytes, and its channels.

        Raises VolspecError if it cannot be cast, or ``cancel`` returned True.
        """
        camera = self.camera(request)
        detail = self._moving if request.coarse else WHOLE
        started = time.perf_counter()
        image = self._cast(camera, detail, cancel)
        packed = pack_view(image, PageSpec().bits)
        ms = 1e3 * (time.perf_counter() - started)
        self._pace = self._pace.after(detail, ms + (request.transfer_ms if request.coarse else 0))
        numbers = packed.numbers() | {
            "coarse": detail != WHOLE,
            "ms": round(ms),
            "marks": svg_elements(self._marks(camera)),
            "notice": image.notes.get(GAPS, ""),
        }
        header = json.dumps(numbers, separators=(",", ":")).encode("ascii")
        return struct.pack(">I", len(header)) + header + packed.data

    def camera(self, request: ViewRequest) -> Camera:
        """Return the camera of a request. Raises CameraError if it would be at its target."""
        orbit = self.orbit
        turned = replace(
            orbit,
            azimuth_deg=request.azimuth_deg,
            elevation_deg=request.elevation_deg,
            zoom=orbit.zoom / request.distance,
        )
        return turned.camera(self.volume)

    @property
    def _moving(self) -> Pass:
        """The pass while the camera moves: of a volume larger than memory, what is in it."""
        moving = self._pace.moving
        is_larger = moving == WHOLE and self.volume.pyramid is not None
        return Pass(1, "voxel") if is_larger else moving

    def _cast(
        self,
        camera: Camera,
        detail: Pass,
        cancel: Cancel | None = None,
        progress: Progress | None = None,
    ) -> CoefficientImage:
        width, height = (-(-side // detail.divisor) for side in self.size)
        return raycast(
            self.volume,
            self.scene.transfer,
            camera,
            (width, height),
            detail.spec(self.scene.raycast, self.volume),
            cancel=cancel,
            progress=progress,
            caster=self._caster,
            behind=self._surfaces,
        )

    def _marks(self, camera: Camera) -> str:
        """Return the scene's annotations, in pixels of whole pictures."""
        return annotation_svg(self.scene.file.annotation, camera, self.size)


def scene_orbit(scene: Scene, volume: Volume) -> Orbit:
    """Return the orbit of a scene's camera, also of one with a position; elevation within ±90."""
    table = scene.file.camera
    keys = {f.name: getattr(table, f.name) for f in fields(Orbit)}
    if table.position_mm is not None:
        camera = scene.camera(volume)
        direction = np.subtract(camera.position_mm, camera.target_mm) / camera.distance_mm
        side, front, axis = level_axes(camera.up)
        keys["azimuth_deg"] = math.degrees(math.atan2(direction @ side, direction @ front))
        keys["elevation_deg"] = math.degrees(math.asin(min(max(direction @ axis, -1.0), 1.0)))
        keys["target_mm"] = camera.target_mm
        sine = math.sin(math.radians(camera.fov_deg) / 2)
        keys["zoom"] = radius_mm(volume) / sine / camera.distance_mm
    azimuth, elevation = keys["azimuth_deg"], math.remainder(keys["elevation_deg"], 360.0)
    if abs(elevation) > 90.0:  # the same camera from the other side, upside down
        azimuth, elevation = azimuth + 180.0, math.copysign(180.0, elevation) - elevation
        keys["roll_deg"] += 180.0
    return Orbit(**keys | {"azimuth_deg": math.remainder(azimuth, 360), "elevation_deg": elevation})


def svg_elements(marks: str) -> list[Any]:
    """Return SVG as nested [name, attributes, children or text], from which a page makes elements.

    >>> svg_elements('<g class="over"><text x="1">A &amp; B</text></g>')
    [['g', {'class': 'over'}, [['text', {'x': '1'}, 'A & B']]]]
    """
    return [_element(child) for child in ElementTree.fromstring(f"<svg>{marks}</svg>")]


def _element(node: ElementTree.Element) -> list[Any]:
    return [node.tag, node.attrib, node.text or [_element(child) for child in node]]


@dataclass(frozen=True, slots=True, eq=False)
class PendingCast:
    """A request in the queue, or being cast."""

    request: ViewRequest
    superseded: Event = field(default_factory=Event)

    def cancel(self) -> None:
        """End the cast within moments, or before it starts."""
        self.superseded.set()


class CastQueue:
    """One thread that casts requests in turn; a client's newest cancels its earlier one.

    Only one thread may call its methods.
    """

    def __init__(self, message: Callable[[ViewRequest, Cancel], bytes]) -> None:
        self._message = message
        self._newest: dict[int, PendingCast] = {}
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="volspec-serve")

    def submit(self, request: ViewRequest) -> tuple[PendingCast, Future[bytes]]:
        """Queue a request; its future raises CastCancelled if a newer one replaces it."""
        if earlier := self._newest.get(request.client):
            earlier.cancel()
        pending = self._newest[request.client] = PendingCast(request)
        return pending, self._pool.submit(self._answer, pending)

    def done(self, pending: PendingCast) -> None:
        """Forget a request that was answered."""
        if self._newest.get(pending.request.client) is pending:
            del self._newest[pending.request.client]

    def close(self) -> None:
        """Cancel all casts, and wait for the thread."""
        for pending in self._newest.values():
            pending.cancel()
        self._pool.shutdown()

    def _answer(self, pending: PendingCast) -> bytes:
        if pending.superseded.is_set():
            raise CastCancelled("view: cancelled before it was cast", code="state")
        return self._message(pending.request, pending.superseded.is_set)
