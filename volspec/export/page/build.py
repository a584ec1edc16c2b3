"""Put a page together: channels, numbers, shaders, scripts and styles in one HTML file.

    views, lights, RelightSpec -> [build] -> PAGE.html

The page asks the network for nothing, and its own policy forbids it: scripts and styles are known
by their hashes, pictures are data. What users wrote reaches it escaped, as text.
"""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

from volspec import __version__
from volspec._files import write_whole
from volspec.errors import ImageError, ShapeError
from volspec.export.page import payload
from volspec.export.page.channels import carried
from volspec.pipeline import Relighter
from volspec.raycast import CoefficientImage
from volspec.relight import RelightSpec
from volspec.scene.lights import NamedLight

BITS = (8, 12)
_WEB = Path(__file__).parent / "web"
# In the order in which they are joined; each uses what stands before it.
_SCRIPTS = (
    *("algebra", "illumination", "conditions", "passages", "looks", "channels", "relight"),
    *("lighting", "state", "elements", "spectrum", "dial", "lights", "viewing", "errors"),
    *("probe", "stage", "share", "widget", "main"),
)
_POLICY = (
    "default-src 'none'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; "
    "require-trusted-types-for 'script'; trusted-types 'none'"
)


@dataclass(frozen=True, slots=True)
class PageSpec:
    """What a page is called and how fine its channels are.

    Parameters
    ----------
    title : str
    caption : str
        A few words below the title; plain text.
    bits : int
        Of each channel's codes: 8, or up to 12 for twice the size.

    Raises
    ------
    ImageError
        If a word is no text or the bits are others.
    """

    title: str = "Relightable picture"
    caption: str = ""
    bits: int = 8

    def __post_init__(self) -> None:
        for name in ("title", "caption"):
            if not isinstance(getattr(self, name), str):
                raise ImageError.refused(f"page: {name}", getattr(self, name), "give text")
        whole = isinstance(self.bits, int) and not isinstance(self.bits, bool)
        if not (whole and BITS[0] <= self.bits <= BITS[1]):
            raise ImageError(f"page: bits are {self.bits!r}; give {BITS[0]} to {BITS[1]}")


@dataclass(frozen=True, slots=True, eq=False)
class PageView:
    """A picture of a page.

    Parameters
    ----------
    image : CoefficientImage
    azimuth_deg : float
        How far around it was cast, from the first.
    """

    image: CoefficientImage
    azimuth_deg: float = 0.0


def write_page(
    path: str | os.PathLike[str],
    views: Iterable[PageView],
    lights: Sequence[NamedLight],
    seen: RelightSpec | None = None,
    spec: PageSpec | None = None,
) -> int:
    """Write a page, whole or not at all.

    Parameters
    ----------
    path : str or path
        Ends in ``.html``.
    views, lights, seen, spec
        As `page_html`.

    Returns
    -------
    int
        Bytes written.

    Raises
    ------
    ImageError
        If the name does not end in ``.html``, or there is no view or light.
    InputError
        If the folder cannot be written to.
    ShapeError, ViewingError
        As `page_html`.
    """
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise ImageError(f"{os.fspath(path)}: pages are HTML files; name it .html")
    data = page_html(views, lights, seen, spec).encode("utf-8")
    with write_whole(path) as temporary:
        temporary.write_bytes(data)
    return len(data)


def page_html(
    views: Iterable[PageView],
    lights: Sequence[NamedLight],
    seen: RelightSpec | None = None,
    spec: PageSpec | None = None,
) -> str:
    """A page as text, to be kept as UTF-8.

    Parameters
    ----------
    views : iterable of PageView
        Of one size, basis and light groups; the first is shown. Taken one at a time.
    lights : sequence of NamedLight
        What can be switched on; the first is.
    seen : RelightSpec, optional
        How the page looks when it is opened.
    spec : PageSpec, optional

    Raises
    ------
    ImageError
        If there is no view or no light.
    ShapeError
        If views differ in size, basis or light groups.
    ViewingError
        If the backdrop is a spectrum.
    """
    seen, spec = seen or RelightSpec(), spec or PageSpec()
    if not lights:
        raise ImageError("page: there is no light; give at least one")
    first: CoefficientImage | None = None
    blocks, told = [], []
    for i, view in enumerate(views):
        first = first or view.image
        _require_alike(view.image, first, i)
        packed = carried(view.image, spec.bits)
        blocks.append(f'<script type="text/plain" id="view-{i}">{packed.text}</script>')
        told.append({"azimuth_deg": view.azimuth_deg, "low": packed.low, "high": packed.high})
    if first is None:
        raise ImageError("page: there is no view; give at least one")
    width, height = first.size
    channels = first.coefficients.shape[2]
    numbers = {
        "title": spec.title,
        "channels": {"width": width, "height": height, "count": channels + 1, "bits": spec.bits},
        "views": told,
        "groups": dict(first.groups),
        "basis": payload.basis_numbers(first.basis),
        "lights": [payload.light_numbers(light, first.basis.grid) for light in lights],
        "look": payload.look_numbers(seen, lights),
        **payload.page_viewing(seen.viewing),
        "models": payload.models(),
        "heat": payload.heat_colours(),
        "constants": payload.constants(),
        "shader": payload.shaders(channels, height),
    }
    still = _still(first, lights[0], seen)
    return _assembled(spec, numbers, still, "\n".join(blocks), (width, height))


def script() -> str:
    """The page's scripts as one."""
    parts = (f"// {name}.js\n{_read(f'{name}.js')}" for name in _SCRIPTS)
    return "'use strict';\n(() => {\n" + "\n".join(parts) + "})();\n"


def _assembled(
    spec: PageSpec, numbers: dict[str, Any], still: str, views: str, size: tuple[int, int]
) -> str:
    code, style = script(), _read("page.css")
    return Template(_read("page.html")).substitute(
        policy=_POLICY.format(script=_hash(code), style=_hash(style)),
        title=_text(spec.title),
        caption=_text(spec.caption),
        version=_text(__version__),
        style=style,
        script=code,
        numbers=_json(numbers),
        views=views,
        still=still,
        width=size[0],
        height=size[1],
    )


def _require_alike(image: CoefficientImage, first: CoefficientImage, number: int) -> None:
    alike = (
        image.coefficients.shape == first.coefficients.shape
        and image.basis.fingerprint == first.basis.fingerprint
        and dict(image.groups) == dict(first.groups)
    )
    if not alike:
        raise ShapeError(
            f"page: view {number + 1} is {image!r}, the first {first!r}; cast all views of one "
            "size, basis and light groups"
        )


def _still(image: CoefficientImage, light: NamedLight, seen: RelightSpec) -> str:
    """The picture under the first light as a data address, for browsers without WebGL 2."""
    from PIL import Image

    with Relighter(image) as relighter:
        frame = relighter.frame(light.rig, seen)
    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, "JPEG", quality=88)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def _text(words: str) -> str:
    """Words for HTML: what is no ASCII as character references, so that no mark of it acts here."""
    kept = "".join(c if c.isprintable() or ord(c) > 127 else " " for c in words)
    return html.escape(kept).encode("ascii", "xmlcharrefreplace").decode("ascii")


def _json(numbers: dict[str, Any]) -> str:
    """JSON that no HTML parser ends early: ASCII without <, > and &."""
    plain = json.dumps(numbers, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    for mark in "<>&":
        plain = plain.replace(mark, f"\\u{ord(mark):04x}")
    return plain


def _hash(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode("utf-8")).digest()).decode("ascii")


def _read(name: str) -> str:
    return (_WEB / name).read_text(encoding="utf-8")
