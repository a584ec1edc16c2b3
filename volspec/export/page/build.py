"""Build a page: channels, numbers, shaders, scripts and styles in one HTML file.

    scene -> views, lights, RelightSpec -> [build] -> PAGE.html

The page's content security policy forbids network access: scripts and styles are allowed by their
hashes, pictures are data URLs. Users' texts are escaped.
"""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from string import Template
from typing import Annotated, Any

from pydantic import Field

from volspec import __version__
from volspec._files import require_suffix, write_whole
from volspec.basis import MaterialBasis
from volspec.errors import ImageError, ShapeError, VolspecWarning
from volspec.export.animation import turntable_cameras
from volspec.export.annotate import annotation_svg, warn_of_cut
from volspec.export.page import payload
from volspec.export.page.packing import PackedLayers, layer_bytes, pack_layers, pack_view
from volspec.export.tiles import part_of
from volspec.export.value_bars import ValueBar, channel_bars
from volspec.image import CoefficientImage, DepthEffects, OpacityLayers
from volspec.pipeline import Raycaster, raycast, relight
from volspec.raycast.launch import Progress
from volspec.relight import Look, Pixels, RelightSpec, full_band_basis
from volspec.scene import Scene
from volspec.scene.tables import NamedLight, Turntable
from volspec.settings import settings
from volspec.volume import Series, Volume

BITS = (8, 12)
MAX_VIEWS = 360
# Of textures; phones give a page hardly more.
_MAX_LAYER_BYTES = 256e6
# Of a pixel; measured from 0.8 to 2.
_BYTES_PER_LAYER = 1.3
# Browsers' strings end a little above.
_MAX_PAGE_BYTES = 500e6
_WEB = Path(__file__).parent / "web"
# Joined in this order: each uses the scripts before it. illumination, conditions, view_transform
# are the third copy of light matrices and CIECAM, after NumPy and GLSL: pages work offline for any
# weights, model and surround (docs/architecture.md). tests/page/test_twins.py compares the copies.
_SCRIPTS = (
    "algebra illumination conditions view_transform looks channels relight recompose nearby "
    "lighting state elements spectrum dial lights opacity depth viewing values errors probe stage "
    "share widget camera main"
)
_POLICY = (
    "default-src 'none'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; "
    "img-src data: blob:;{network} base-uri 'none'; form-action 'none'; "
    "require-trusted-types-for 'script'; trusted-types 'none'"
)


@settings(ImageError)
@dataclass(frozen=True, slots=True)
class PageSpec:
    """Title of a page, precision of its channels, and rate of its time steps.

    Raises
    ------
    ImageError
        If the title or caption is not text, or bits are out of range.
    """

    title: str = "Relightable picture"
    """Title of the page."""
    caption: str = ""
    """Plain text below the title."""
    bits: Annotated[int, Field(ge=BITS[0], le=BITS[1])] = 8
    """Bits of a channel's code: 8, or up to 12 at twice the file size."""
    fps: Annotated[float, Field(gt=0, le=240, allow_inf_nan=False)] = 10.0
    """Time steps per second at which a series plays."""


@dataclass(frozen=True, slots=True, eq=False)
class PageView:
    """A picture of a page.

    Parameters
    ----------
    image : CoefficientImage
    azimuth_deg : float
        Angle from the first view's camera.
    step : int
        Time step of a series, from 0.
    marks : str
        SVG drawn over the picture, in its pixels; for example `annotation_svg`.
    opacities : {material: scale}
        Of the sliders when the page is opened; 1 for those that are left out. Only if the image was
        cast with layers.
    depth : DepthEffects
        Cuts, fog and focus when the page is opened, likewise.
    values : sequence of ValueBar
        Bars below the page's pictures, of its first view: `channel_bars`.
    """

    image: CoefficientImage
    azimuth_deg: float = 0.0
    marks: str = ""
    step: int = 0
    opacities: Mapping[str, float] = field(default_factory=dict)
    depth: DepthEffects = field(default_factory=DepthEffects)
    values: Sequence[ValueBar] = ()


def layers_size(pictures: int, layers: int, size: tuple[int, int]) -> str:
    """Estimate what layers of opacity take in a page, of three materials, as text."""
    return _megabytes(_BYTES_PER_LAYER * pictures * layers * size[0] * size[1])


@dataclass(frozen=True, slots=True)
class ServedCamera:
    """Camera of a page whose server casts other views.

    Parameters
    ----------
    azimuth_deg, elevation_deg : float
        Direction of the first picture's camera.
    distances : (float, float)
        Least and greatest distance, as factors of the first picture's.
    size : (width, height)
        Pixels of whole pictures; the first may be coarser.
    coarse : bool
        True if the first is.
    notice : str
        Message about the first picture, such as of missing parts.
    """

    azimuth_deg: float
    elevation_deg: float
    distances: tuple[float, float]
    size: tuple[int, int]
    coarse: bool = False
    notice: str = ""


def write_page(
    path: str | os.PathLike[str],
    views: Iterable[PageView],
    lights: Sequence[NamedLight],
    relight_spec: RelightSpec | None = None,
    spec: PageSpec | None = None,
) -> int:
    """Write a page.

    Parameters
    ----------
    path : str or path
        Name that ends in ``.html``, else `ImageError`.
    views, lights, relight_spec, spec
        As in `page_html`, and so are the other errors.

    Returns
    -------
    int
        Bytes written.
    """
    require_suffix(path, "pages", ".html", ".htm")
    data = page_html(views, lights, relight_spec, spec).encode("utf-8")
    if len(data) > _MAX_PAGE_BYTES:
        raise ImageError(
            f"{path}: {len(data) / 1e6:.0f} MB is more than browsers open, "
            f"{_MAX_PAGE_BYTES / 1e6:.0f} MB",
            "give fewer or smaller views, or 8 bits",
            code="size",
            field="page",
        )
    with write_whole(path) as temporary:
        temporary.write_bytes(data)
    return len(data)


def page_html(
    views: Iterable[PageView],
    lights: Sequence[NamedLight],
    relight_spec: RelightSpec | None = None,
    spec: PageSpec | None = None,
    served: ServedCamera | None = None,
) -> str:
    """Build a page as text, to be written as UTF-8.

    Parameters
    ----------
    views : iterable of PageView
        Views of equal size, basis and light groups, step by step; the first is shown. Consumed one
        at a time.
    lights : sequence of NamedLight
        Lights; the first is switched on.
    relight_spec : RelightSpec, optional
        Settings of the page when it is opened.
    spec : PageSpec, optional
    served : ServedCamera, optional
        Of a page that asks its server for further views; other pages use no network.

    Raises
    ------
    ImageError, ShapeError
        If there are no views or lights; if views differ.
    ViewingError
        If the backdrop is a spectrum.
    """
    relight_spec, spec = relight_spec or RelightSpec(), spec or PageSpec()
    if not lights:
        raise ImageError.refused("page.lights", lights, "give at least one", "missing")
    first: CoefficientImage | None = None
    bars: Sequence[ValueBar] = ()
    opacity: PackedLayers | None = None
    scales: list[float] = []
    effects = DepthEffects()
    blocks, packed_views, marks = [], [], []
    for i, view in enumerate(views):
        first, bars = first or view.image, bars if first else view.values
        if i == 0 and not served and first.opacity_layers is not None:
            scales = first.opacity_scales(view.opacities)
            opacity = _packed_layers(first, first.opacity_layers)
            effects = view.depth
        _require_alike(view.image, first, i)
        packed = pack_view(view.image, spec.bits)
        blocks.append(f'<script type="text/plain" id="view-{i}">{packed.text}</script>')
        # Not in the numbers: the page's policy allows no markup from scripts.
        marks.append(f'<g id="marks-{i}" display="none">{view.marks}</g>' if view.marks else "")
        packed_views.append(
            {
                "azimuth_deg": view.azimuth_deg,
                "step": view.step,
                **packed.numbers(),
            }
        )
    if first is None:
        raise ImageError(
            "there is no view", "give at least one", code="missing", field="page.views"
        )
    if opacity and len(packed_views) > 1:
        _warn_without_layers(len(packed_views), _megabytes(len(packed_views) * len(opacity.text)))
        opacity = None
    if opacity:
        blocks.append(f'<script type="text/plain" id="layers">{opacity.text}</script>')
    width, height = served.size if served else first.size
    seen_through = relight_spec.seen_through(first.basis.grid)
    channels = first.coefficients.shape[2]
    numbers = {
        "title": spec.title,
        "channels": {"width": width, "height": height, "count": channels + 1, "bits": spec.bits},
        "views": packed_views,
        "fps": spec.fps,
        "groups": dict(first.groups),
        "basis": payload.basis_numbers(first.basis, seen_through, full_band_basis(first)),
        # A file without its folder, which is of this machine.
        "filter": os.path.basename(relight_spec.filter or ""),
        "lights": [payload.light_numbers(light, first.basis, seen_through) for light in lights],
        "look": payload.look_numbers(relight_spec, lights)
        | ({"opacity": scales, **payload.depth_look(effects, first)} if opacity else {}),
        "opacity": payload.opacity_numbers(opacity, first, effects),
        **payload.page_viewing(relight_spec.viewing),
        "models": payload.models(),
        "values": payload.bar_numbers(bars, first.basis, first.groups),
        "heat": payload.heat_colours(),
        "constants": payload.constants(),
        "shader": payload.shaders(channels, height, opacity),
        "served": asdict(served) if served else None,
    }
    look = Look(relight_spec)
    if opacity and isinstance(first.basis, MaterialBasis):
        named = dict(zip(first.basis.materials, scales, strict=True))
        look = replace(look, opacities=named, depth=effects)
    still = _still(relight(first, lights[0].rig, look))
    texts = {"views": "\n".join(blocks), "marks": "".join(marks)}
    return _fill_template(spec, numbers, still, texts, (width, height))


def scene_views(
    scene: Scene,
    count: int = 1,
    *,
    size: tuple[int, int] | None = None,
    device: str | None = None,
    progress: Progress | None = None,
    volume: Volume | None = None,
    caster: Raycaster | None = None,
    series: Series | None = None,
) -> Iterator[PageView]:
    """Cast a scene from cameras around it, each at every step of a series if one is given.

    Parameters
    ----------
    scene : Scene
    count : int
        Number of cameras on a circle around the scene's ``up``; the first is the scene's own.
    size, device, progress, volume, caster
        As in `Scene.render`.
    series : Series, optional
        Time steps of the scene's volume: `Scene.series`.

    Only a single picture has the layers of opacity that the scene asks for.

    Raises
    ------
    ImageError
        If there are more than 360 pictures.
    """
    steps = len(series) if series else 1
    if count * steps > MAX_VIEWS:
        raise ImageError(
            f"{count} views of {steps} time steps are {count * steps} pictures; a page holds up to "
            f"{MAX_VIEWS}",
            f"give at most {MAX_VIEWS // steps} views" if steps <= MAX_VIEWS else "leave out steps",
            code="size",
        )
    if series and not caster:
        volume = series[0]
    volume = caster.volume if caster else volume or scene.volume()
    first, surfaces = caster or Raycaster(volume, device=device), scene.behind(volume)
    bars = scene_bars(scene, volume)
    pixels = size or (scene.file.output.width, scene.file.output.height)
    cameras = turntable_cameras(scene, volume, Turntable(frames=count))
    total = count * steps
    if total > 1 and scene.raycast.layers:
        _warn_without_layers(total, layers_size(total, scene.raycast.layers, pixels))
    spec, opacities = replace(scene.raycast, layers=0), {}
    if total == 1 and scene.raycast.layers:
        # Sliders scale what is cast, from which a hidden material would be missing.
        spec, opacities = replace(scene.raycast, opacities={}), scene.raycast.opacities
    for step in range(steps):
        step_caster = Raycaster(series[step], like=first) if series else first
        for i, camera in enumerate(cameras):
            done = step * count + i
            image = raycast(
                step_caster.volume,
                scene.transfer,
                camera,
                pixels,
                spec,
                caster=step_caster,
                progress=progress and part_of(progress, done / total, 1 / total),
                behind=surfaces,
            )
            warn_of_cut(scene.file.annotation, camera, pixels)
            marks = annotation_svg(scene.file.annotation, camera, pixels)
            depth = scene.file.depth if spec.layers else DepthEffects()
            yield PageView(image, 360.0 * i / count, marks, step, opacities, depth, bars)


def scene_bars(scene: Scene, volume: Volume) -> Sequence[ValueBar]:
    """Return the bars of a scene's pages; none unless ``[export] annotate`` has ``"values"``."""
    asked = "values" in scene.file.export.annotate
    return channel_bars(scene.transfer, volume, scene.basis) if asked else ()


def script() -> str:
    """Join the page's scripts."""
    parts = (f"// {name}.js\n{_read(f'{name}.js')}" for name in _SCRIPTS.split())
    return "'use strict';\n(() => {\n" + "\n".join(parts) + "})();\n"


def page_policy(*, served: bool = False) -> str:
    """Return the content security policy of pages; a served one may ask its own server."""
    network = " connect-src 'self';" if served else ""
    return _POLICY.format(script=_hash(script()), style=_hash(_read("page.css")), network=network)


def _fill_template(
    spec: PageSpec,
    numbers: dict[str, Any],
    still: str,
    texts: dict[str, str],
    size: tuple[int, int],
) -> str:
    code, style = script(), _read("page.css")
    return Template(_read("page.html")).substitute(
        policy=page_policy(served=numbers["served"] is not None),
        title=_text(spec.title),
        caption=_text(spec.caption),
        version=_text(__version__),
        style=style,
        script=code,
        numbers=_json(numbers),
        **texts,
        still=still,
        width=size[0],
        height=size[1],
    )


def _packed_layers(image: CoefficientImage, layers: OpacityLayers) -> PackedLayers:
    """Pack an image's layers of opacity; refuse more than browsers hold."""
    width, height = image.size
    size_bytes = layer_bytes(layers)
    if size_bytes > _MAX_LAYER_BYTES:
        raise ImageError(
            f"{layers.count} layers of opacity of {width}x{height} take "
            f"{size_bytes / 1e6:.0f} MB of a browser's memory, which is more than "
            f"{_MAX_LAYER_BYTES / 1e6:.0f} MB",
            "cast it smaller, or with fewer layers or none",
            code="size",
            field="page.layers",
        )
    return pack_layers(layers)


def _megabytes(count: float) -> str:
    return f"{count / 1e6:.0f} MB" if count > 2e6 else f"{count / 1e6:.1f} MB"


def _warn_without_layers(pictures: int, size: str) -> None:
    warnings.warn(
        f"page: {pictures} pictures are without layers of opacity, which would take some {size}; "
        "only a page of a single picture has them",
        VolspecWarning,
        stacklevel=3,
    )


def _require_alike(image: CoefficientImage, first: CoefficientImage, number: int) -> None:
    alike = (
        image.coefficients.shape == first.coefficients.shape
        and image.basis.fingerprint == first.basis.fingerprint
        and dict(image.groups) == dict(first.groups)
    )
    if not alike:
        raise ShapeError(
            f"view {number + 1} is {image!r}, but the first is {first!r}",
            "cast all views with the same size, basis and light groups",
            field="page.views",
        )


def _still(frame: Pixels) -> str:
    """Return the picture under the first light as a data URL, for browsers without WebGL 2."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, "JPEG", quality=88)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def _text(words: str) -> str:
    """Escape text for HTML, with character references for everything but ASCII."""
    printable = "".join(c if c.isprintable() or ord(c) > 127 else " " for c in words)
    return html.escape(printable).encode("ascii", "xmlcharrefreplace").decode("ascii")


def _json(numbers: dict[str, Any]) -> str:
    """Encode as JSON that an HTML parser cannot end early: ASCII without <, > and &."""
    text = json.dumps(numbers, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    for mark in "<>&":
        text = text.replace(mark, f"\\u{ord(mark):04x}")
    return text


def _hash(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode("utf-8")).digest()).decode("ascii")


def _read(name: str) -> str:
    return (_WEB / name).read_text(encoding="utf-8")
