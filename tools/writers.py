"""Each setting of the viewer, as the window shows it and as every writer writes it: one picture.

    state -> window | picture, scene, export, EXR, sheet, script, film, page, session -> codes

Run ``python -m tools.writers``, with names of settings to see only these. A row is a setting, a
column a writer: its greatest difference from the window in codes of 8 bits, or its refusal.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import copykitten
import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from PIL import Image
from PIL.Image import Resampling

from tests.support.browser import chromium, missing, saved_picture
from tests.support.headless import HeadlessViewer
from tests.support.viewer import HEAD, read_scene, run_command
from volspec._exr import read_exr
from volspec.appearance.display.monitors import colour_space
from volspec.appearance.spec import HuntSettings, NayataniSettings
from volspec.basis import SpectralBasis
from volspec.errors import ImageError, VolspecError, VolspecWarning, one_line
from volspec.export.contact_sheet import _MARGIN
from volspec.export.exporter import export
from volspec.export.exr import PRIMARIES, white_adaptation
from volspec.export.overview import _TILE
from volspec.large.conversion import convert
from volspec.raycast import ClipPlane, Directional, LightGroup
from volspec.relight import LightRig
from volspec.scene import Scene
from volspec.scene.tables.annotation import Annotation
from volspec.scene.tables.export import ExportSpec
from volspec.scene.tables.specs import MeshSpec
from volspec.spectra import light, reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model import depth, light_parts, lights, meshes, opacities, transfer_edits
from volspec.viewer.model.depth import focused_depth, shown_stereo
from volspec.viewer.model.edit import Edited
from volspec.viewer.model.film import Film
from volspec.viewer.model.light_rows import LightRow
from volspec.viewer.model.scene_file import export_python, export_scene, left_out
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.films import FRAMES, FilmFile, PageFile, save_film, save_page
from volspec.viewer.work.outputs import Destination, Progress
from volspec.viewer.work.screenshot import Still, copy_shown, save_picture
from volspec.viewer.work.session import SUFFIX, read_session, restore_state, save_session
from volspec.volume import Volume
from volspec.volume.out_of_memory import level_of

Codes = NDArray[np.int_]
Edit = Callable[[ViewState], ViewState | Edited]
# Pixels of the picture with all panels closed; even, as those of films are.
SIZE = 64, 48
BARS = 47  # the menu and the status line, in pixels
MAX_CODES = 2
# Of a page's lens, which has fewer points: .6 of CIEDE2000 in the mean (tests/page/test_depth.py),
# and more at single pixels on the edges of meshes; one code in the mean.
MAX_LENS_CODES = 32
# Of a page's pixels, those at the border of the gamut, where a mark is there or not: its
# coefficients have fewer bits.
MAX_AT_BORDER = 1e-3
# Of eyes next to each other, which a file has cast at their size, and the window reprojects to it.
MAX_PAIR_CODES = 24

_POINTS = """points = [
    { value = 0.2, opacity = 0.0, material = "copper" },
    { value = 0.5, opacity = 0.2, material = "copper" },
    { value = 0.9, opacity = 0.5, material = "grey" },
]"""
_FIELD = """[[field]]
name = "other"
file = "other.npy"
[field.transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "grey" },
    { value = 0.8, opacity = 0.4, material = "grey" },
]"""
_LABELS = """labels = [
    { label = 1, opacity = 0.3, material = "copper" },
    { label = 2, opacity = 1.0, material = "grey" },
]"""
_EXACT, _GENERAL = 'method = "materials"', 'name = "general-5"'
# File, transfer function, basis and further tables.
DOCUMENTS = {
    "curve": ("balls.npy", _POINTS, _EXACT, ""),
    "general basis": ("balls.npy", _POINTS, _GENERAL, ""),
    "labels": ("labels.npy", _LABELS, _GENERAL, ""),
    "two fields": ("balls.npy", _POINTS, _GENERAL, _FIELD + "\n[raycast]\nadd_fields = true\n"),
    "time steps": ("step*.npy", _POINTS, _EXACT, ""),
    "larger than memory": ("large.zarr?memory=4MiB", _POINTS, _GENERAL, ""),
}


def write_documents(folder: Path) -> dict[str, Path]:
    """Write the scenes in which settings are tried; return their paths by name."""
    z, y, x = np.mgrid[:14, :14, :14] / 13.0
    near = np.exp(-(((x - 0.35) ** 2 + (y - 0.4) ** 2 + (z - 0.6) ** 2) / 0.05))
    far = np.exp(-(((x - 0.7) ** 2 + (y - 0.6) ** 2 + (z - 0.35) ** 2) / 0.02))
    values = np.maximum(near, 0.8 * far).astype(np.float32)
    for name, data in (
        ("balls", values),
        ("other", values[::-1].copy()),
        ("step0", values),
        ("step1", values[:, ::-1].copy()),
        ("labels", ((near > 0.5) + 2 * (far > 0.5)).clip(0, 2).astype(np.uint8)),
    ):
        np.save(folder / f"{name}.npy", data)
    large = Volume(np.kron(values, np.ones((8, 8, 8), np.float32)))
    convert(level_of(large), folder / "large.zarr", name="large")
    for name, (file, transfer, basis, more) in DOCUMENTS.items():
        text = HEAD.replace("ball.npy", file) % (transfer, basis) + more
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.toml" for name in DOCUMENTS}


def at(state: ViewState, path: str, value: Any) -> ViewState:
    """Return a state with a value at a path such as ``relight.viewing.D``."""
    return _at(state, path.split("."), value)


def _at(whole: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    return replace(whole, **{first: _at(getattr(whole, first), rest, value) if rest else value})


def _set(**values: Any) -> Edit:
    """Return an edit that sets values at paths, whose dots are written as ``__``."""

    def edit(state: ViewState) -> ViewState:
        for path, value in values.items():
            state = at(state, path.replace("__", "."), value)
        return state

    return edit


def applied(edit: Edit, state: ViewState) -> ViewState:
    """Return an edited state, of edits that may refuse, too."""
    made = edit(state)
    return made.state if isinstance(made, Edited) else made


# The scale bar is drawn over the window's picture.
without_panels = _set(interface__panels=frozenset(), interface__overlays__scale=False)


def chain(*edits: Edit) -> Edit:
    def edit(state: ViewState) -> ViewState:
        for each in edits:
            state = applied(each, state)
        return state

    return edit


def _depth(**values: Any) -> Edit:
    """Return an edit of effects of depth; distances are parts of the volume's depth."""

    def edit(state: ViewState) -> ViewState:
        start, end = depth.limits_mm(state)
        given = dict(values)
        for key in ("near_mm", "far_mm", "focus_mm", "fog_from_mm"):
            if key in given:
                given[key] = start + given[key] * (end - start)
        if "fog_mm" in given:
            given["fog_mm"] *= end - start
        return replace(state, depth=replace(state.depth, **given))

    return edit


def _row(**changes: Any) -> Edit:
    """Return an edit of the first light."""
    return lambda state: replace(
        state, lights=(replace(state.lights[0], **changes), *state.lights[1:])
    )


def _two_groups(state: ViewState) -> ViewState:
    """Return a state whose two lights shine from two places."""
    key = LightGroup("key", (Directional((1, 0, 1), shadows=True),))
    fill = LightGroup("fill", (Directional((-1, 0, 0)),))
    rig = LightRig((light("A"), light("D65")), (0.5, 1.0), groups=("key", "fill"))
    row = LightRow("two", "", rig, 1.0, texts=("A", "D65"))
    return replace(_set(shading__groups=(key, fill))(state), lights=(row, *state.lights))


_SHADOWS = _set(shading__groups=(LightGroup("light", (Directional((1, 0, 1), shadows=True),)),))
_STRONG = _set(relight__viewing__exposure=3.0)
_SPECULAR = _set(shading__specular=0.8)
_PICTURE_EYE = _set(relight__viewing__adapting="picture")
_HUNT = _set(relight__viewing__model="Hunt")
_FOCUS = _depth(focus_mm=0.3, aperture_mm=6.0)
_FOG = _depth(fog_mm=1.0, fog_from_mm=0.1)
_MESH = MeshSpec(shape="sphere", size_mm=6.0, material="grey", move_mm=(3.0, 3.0, 8.0))


def _general(state: ViewState) -> ViewState:
    return replace(state, transfer=replace(state.transfer, basis=SpectralBasis.load("general-5")))


def _with_filter(state: ViewState) -> ViewState:
    curve: Any = _general(state).transfer
    if not isinstance(curve, TransferFunction):
        return state
    filters = {"copper": reflectance("bandpass:600/200")}
    return replace(state, transfer=replace(curve, filters=filters))


# Paths of the state, with an edit that shows.
EDITS: dict[str, Edit] = {
    "view.azimuth_deg": _set(view__azimuth_deg=75.0),
    "view.elevation_deg": _set(view__elevation_deg=-40.0),
    "view.zoom": _set(view__zoom=1.7),
    "view.fov_deg": _set(view__fov_deg=60.0),
    "view.orthographic": _set(view__orthographic=True),
    "view.roll_deg": _set(view__roll_deg=40.0),
    "view.target_mm": _set(view__target_mm=(9.0, 6.0, 6.0)),
    "view.up": _set(view__up=(0.0, 1.0, 0.0)),
    "transfer": lambda state: transfer_edits.move_point(state, 1, 0.4, 0.9),
    "transfer.filters": _with_filter,
    "shift": lambda state: transfer_edits.shift(state, 0.1),
    "thickness": lambda state: transfer_edits.thicken(state, 3.0),
    "shading.quality": _set(shading__quality="fast"),
    "shading.step_mm": _set(shading__step_mm=2.5),
    "shading.ambient": _set(shading__ambient=0.9),
    "shading.diffuse": _set(shading__diffuse=0.1),
    "shading.specular": _SPECULAR,
    "shading.shininess": chain(_SPECULAR, _set(shading__shininess=2)),
    "shading.alpha_stop": _set(shading__alpha_stop=0.3),
    "shading.flat_gradient": _set(shading__flat_gradient=0.9),
    "shading.groups": _two_groups,
    "shading.mode": _set(shading__mode="maximum"),
    "shading.jitter": _set(shading__jitter=1.0, shading__step_mm=2.0),
    "shading.seed": _set(shading__jitter=1.0, shading__step_mm=2.0, shading__seed=9),
    "shading.preintegrated": _set(shading__preintegrated=True, shading__step_mm=2.0),
    "shading.adaptive": _set(shading__adaptive=0.9),
    "shading.crop_voxels": _set(shading__crop_voxels=((2, 11), (0, 13), (0, 9))),
    "shading.clip_planes": _set(shading__clip_planes=(ClipPlane((7, 6, 6), (-1, 0.5, 0)),)),
    "shading.light_cells": chain(_SHADOWS, _set(shading__light_cells=8)),
    "shading.physical_light": chain(_SHADOWS, _set(shading__physical_light=True)),
    "shading.layers": chain(_set(shading__layers=4), _FOG),
    "shading.opacities": lambda state: opacities.set_opacity(state, "copper", 0.2),
    "lights": chain(
        lambda state: lights.add(state, "HP1"), lambda state: lights.set_weight(state, 2, 0.9)
    ),
    "lights.weight": chain(
        _row(weight=0.4),
        lambda state: lights.set_weight(state, 1, 0.6),
        _set(relight__level="relative"),
    ),
    "lights.solo": lambda state: lights.toggle_solo(lights.set_weight(state, 1, 0.6), 1),
    "lights.muted": lambda state: lights.toggle_mute(lights.set_weight(state, 1, 0.6), 0),
    "lights.kelvin": chain(
        lambda state: lights.add(state, "planck:5000"),
        lambda state: lights.set_weight(lights.set_kelvin(state, 2, 2500.0), 2, 0.9),
    ),
    "lights.rig": lambda state: light_parts.respell(state, 0, 0, "FL2"),
    "relight.mode": chain(
        _general,
        lambda state: light_parts.respell(state, 0, 0, "HP1"),
        _set(relight__mode="componentwise"),
    ),
    "relight.backdrop": _set(relight__backdrop=0.6),
    "relight.level": chain(
        *(partial(light_parts.set_lux, index=number, lux=400.0) for number in range(4)),
        _set(relight__level="absolute"),
    ),
    "relight.filter": _set(relight__filter="longpass:550"),
    "relight.viewing.model": _set(relight__viewing__model="CAM16", relight__viewing__D=0.2),
    "relight.viewing.illuminance_lux": _set(relight__viewing__illuminance_lux=3.0),
    "relight.viewing.L_A": _set(relight__viewing__L_A=0.5),
    "relight.viewing.Y_b": _set(relight__viewing__Y_b=80.0),
    "relight.viewing.surround": _set(relight__viewing__surround="dark"),
    "relight.viewing.adopted_white": _set(relight__viewing__adopted_white=(80.0, 100.0, 40.0)),
    "relight.viewing.D": chain(
        _row(weight=0.0),
        _row(rig=LightRig((light("A"),)), weight=1.0),
        _set(relight__viewing__D=0.1),
    ),
    "relight.viewing.discount": chain(
        lambda state: light_parts.respell(state, 0, 0, "A"), _set(relight__viewing__discount=True)
    ),
    "relight.viewing.exposure": _set(relight__viewing__exposure=1.7),
    "relight.viewing.adapting": _PICTURE_EYE,
    "relight.viewing.fov_deg": chain(_PICTURE_EYE, _set(relight__viewing__fov_deg=5.0)),
    "relight.viewing.hunt": chain(_HUNT, _set(relight__viewing__hunt=HuntSettings(N_b=20.0))),
    "relight.viewing.nayatani": _set(
        relight__viewing__model="Nayatani95",
        relight__viewing__nayatani=NayataniSettings(E_or=100.0),
    ),
    "relight.viewing.Y_A": _set(relight__viewing__Y_A=1.0, relight__viewing__illuminance_lux=20.0),
    "relight.viewing.deficiency": _set(relight__viewing__deficiency="protan"),
    "relight.viewing.severity": _set(
        relight__viewing__deficiency="protan", relight__viewing__severity=0.4
    ),
    "relight.viewing.display.L_A": _set(relight__viewing__display__L_A=500.0),
    "relight.viewing.display.Y_b": _set(relight__viewing__display__Y_b=70.0),
    "relight.viewing.display.surround": _set(relight__viewing__display__surround="dark"),
    "relight.viewing.display.space": _set(relight__viewing__display__space="Display P3"),
    "relight.viewing.display.gamut": chain(
        _STRONG, _set(relight__viewing__display__gamut="reduce")
    ),
    "relight.viewing.display.mark": chain(_STRONG, _set(relight__viewing__display__mark=True)),
    "relight.viewing.display.white_cd_m2": _set(
        relight__viewing__display__L_A=None, relight__viewing__display__white_cd_m2=1000.0
    ),
    "other": lambda state: replace(state, other=(replace(state.lights[1], weight=1.0),)),
    "divide": lambda state: replace(
        state, other=(replace(state.lights[1], weight=1.0),), divide=0.25
    ),
    "annotations": lambda state: replace(
        state, annotations=(Annotation(points_mm=((2, 2, 8), (9, 9, 4)), text="w"),)
    ),
    "meshes": chain(lambda state: meshes.add(state, (_MESH,)), without_panels),
    "depth.near_mm": _depth(near_mm=0.45),
    "depth.far_mm": _depth(far_mm=0.5),
    "depth.fog_mm": _FOG,
    "depth.fog_from_mm": _depth(fog_mm=0.6, fog_from_mm=0.4),
    "depth.fog_white": chain(_FOG, _depth(fog_white=0.9)),
    "depth.focus_mm": _FOCUS,
    "depth.aperture_mm": _depth(focus_mm=0.3, aperture_mm=12.0),
}
_OVER = "is drawn over the picture, not in it"
_WINDOW = "is of the window"
# Fields that no picture shows, and why.
NOT_IN_PICTURES = {
    "document": "is what was opened",
    "chosen_field": "chooses whose transfer function is edited",
    "fields": "is tried with the document of two fields",
    "size": "is tried by resizing the window",
    "interface": _WINDOW,
    "saved_lights": "are lights for later",
    "fade": "is of the window, until it ends",
    "palette": "are targets; the designed spectra are materials and lights",
    "unthickened": "is what undoing a thickness needs",
    "room": "is tried in tests/viewer/test_room.py, as it takes seconds",
    "shading.level": "is of volumes larger than memory",
    "shading.add_fields": "is on in the document of two fields",
    "shading.half": "changes less than a code",
    "shading.first_opacity": "changes distances, no colours",
    "shading.tile_ms": "is of the device",
}


_SPECS = {"view", "shading", "relight", "relight.viewing", "relight.viewing.display", "depth"}


def paths_of(value: Any, within: str = "") -> Iterator[str]:
    """Yield the paths of a state's fields; those of specs field by field."""
    for each in fields(value):
        path = f"{within}{each.name}"
        if path in _SPECS:
            yield from paths_of(getattr(value, each.name), f"{path}.")
        elif each.init:
            yield path


def _nothing(state: ViewState) -> ViewState:
    return state


def _kind(name: str) -> Edit:
    """Return an edit that makes another kind of transfer function."""
    return lambda state: run_command(state, f"transfer-{name}").state


# Documents and edits in which settings are tried.
CONTEXTS: dict[str, tuple[str, Edit]] = {
    "a curve": ("curve", _nothing),
    "cut and fog": ("curve", chain(_depth(near_mm=0.4, far_mm=0.9), _FOG)),
    "a lens": ("curve", _FOCUS),
    "maximum": ("curve", EDITS["shading.mode"]),
    "pre-integrated": ("curve", EDITS["shading.preintegrated"]),
    "regions": ("curve", _kind("regions")),
    "surfaces": ("curve", _kind("surfaces")),
    "two lights": ("curve", EDITS["other"]),
    "a general basis": ("general basis", _nothing),
    "labels": ("labels", _nothing),
    "two fields": ("two fields", _nothing),
    "time steps": ("time steps", _nothing),
    "larger than memory": ("larger than memory", _nothing),
}


@dataclass
class Studio:
    """Folder, viewer, and a page of a browser, if there is one, for writers."""

    folder: Path
    viewer: HeadlessViewer
    page: Any = None

    def new_folder(self) -> Path:
        """Return an empty folder."""
        return Path(tempfile.mkdtemp(dir=self.folder))


def _read(path: Path) -> Codes:
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def _picture(state: ViewState, folder: Path) -> Codes:
    shot = Still(to=Destination(str(folder), "S"), marks=())
    return _read(save_picture(state, shot, Progress("picture")))


def _copied(viewer: HeadlessViewer) -> Codes:
    """Return what Ctrl+C copies."""
    viewer.window.context.__enter__()
    with pytest.MonkeyPatch.context() as patched:
        copied: list[tuple[bytes, int, int]] = []
        patched.setattr(copykitten, "copy_image", lambda *given: copied.append(given))
        copy_shown(viewer.app._screen.pictures, viewer.state)
    data, width, height = copied[0]
    return np.frombuffer(data, np.uint8).reshape(height, width, 4)[..., :3].astype(int)


def _saved_scene(state: ViewState, folder: Path) -> Scene:
    assert state.document.path is not None
    # Next to its volume, whose name is relative.
    path = state.document.path.with_name(f"{folder.name}.toml")
    with suppress(FileNotFoundError):
        path.unlink()
    return Scene.load(export_scene(state, path))


def _exported(state: ViewState, folder: Path, **table: Any) -> Path:
    """Export the first light's frame of the saved scene; return the folder."""
    scene, to = _saved_scene(state, folder), folder / "frames"
    one = ExportSpec(lights=(scene.lights[0].name,), **table)
    scene.file = replace(scene.file, export=one, keyframe=())
    export(scene, to, size=state.size)
    return to


def _frame(folder: Path, suffix: str) -> Path:
    return next(path for path in folder.rglob(f"*{suffix}") if path.name != "sheet.png")


def _exr(state: ViewState, folder: Path) -> Codes:
    _, read = read_exr(
        _frame(_exported(state, folder, format="exr", sheet=False), ".exr"), ImageError
    )
    space, file = colour_space(state.relight.viewing.display.space), PRIMARIES["Rec. 709"]
    linear = np.stack([read[name] for name in "RGB"], axis=-1)
    to = space.RGB_from_XYZ @ white_adaptation(file, space) @ file.XYZ_from_RGB
    return np.rint(space.encode(linear @ to.T) * 255).clip(0, 255).astype(int)


def _sheet(state: ViewState, folder: Path) -> Codes:
    """Return the frame of a contact sheet, in which it is enlarged to the width of a column."""
    to = _exported(state, folder)
    frame, sheet = _read(_frame(to, ".png")), _read(to / "sheet.png")
    size = _TILE, _TILE * frame.shape[0] // frame.shape[1]
    like = np.asarray(Image.fromarray(frame.astype(np.uint8)).resize(size, Resampling.LANCZOS))
    places = sliding_window_view(sheet, (size[1], size[0]), axis=(0, 1))[:, _MARGIN]
    apart = min(abs(each - like.transpose(2, 0, 1).astype(int)).max() for each in places)
    return frame + int(apart)


def _start(state: ViewState, folder: Path) -> Codes:
    again = read_scene(_saved_scene(state, folder).path)
    return _picture(replace(again, size=state.size), folder)


def _script(state: ViewState, folder: Path) -> Codes:
    path = export_python(state, folder / "script.py")
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), {"__file__": str(path)})
    return _read(path.with_suffix(".png"))


def _film(state: ViewState, folder: Path) -> Codes:
    film = Film(degrees=0.0, seconds=0.5, fps=2.0, steps=False)
    file = FilmFile(film, FRAMES, to=Destination(str(folder), "film"))
    return _read(next(save_film(state, file, Progress("film")).glob("*.png")))


def _page(state: ViewState, folder: Path, page: Any) -> Codes:
    file = PageFile(to=Destination(str(folder), "page"), steps=False)
    page.goto(save_page(state, file, Progress("page")).as_uri())
    page.wait_for_selector("html.ready", state="attached")
    return saved_picture(page).astype(int)


def _session(state: ViewState, folder: Path) -> Codes:
    path = save_session(state, folder / f"it{SUFFIX}")
    return _picture(restore_state(read_session(path)), folder)


WRITERS: dict[str, Callable[..., Codes]] = {
    "S": _picture,
    "copied": _copied,
    "fresh start": _start,
    "export": lambda state, to: _read(_frame(_exported(state, to, sheet=False), ".png")),
    "EXR": _exr,
    "sheet": _sheet,
    "script": _script,
    "film": _film,
    "page": _page,
    "session": _session,
}


class Cell(NamedTuple):
    """A writer's greatest difference from the window in codes, and what it said."""

    codes: int | None
    words: tuple[str, ...]
    most: int = MAX_CODES

    @property
    def agrees(self) -> bool:
        """True if the picture is the window's, or a line says what is not."""
        return (self.codes is not None and self.codes <= self.most) or bool(self.words)


def tried(
    studio: Studio, state: ViewState, writers: Iterable[str] = tuple(WRITERS)
) -> dict[str, Cell]:
    """Show a state in the window, and return the cells of the writers."""
    viewer = studio.viewer
    viewer.edit(lambda _: state)
    viewer.rest()
    state, shown, folder = viewer.state, viewer.pixels(), studio.new_folder()
    like = {} if shown is None else _expected(state, shown, folder)
    found = dict[str, Cell]()
    for name in writers:
        own = studio.folder / f"{folder.name}-{name.replace(' ', '-')}"
        given = {"copied": (viewer,), "page": (state, own, studio.page)}.get(name, (state, own))
        own.mkdir()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                codes = WRITERS[name](*given)
            except VolspecError as refused:
                told = [one_line(refused) in each.text for each in viewer.app._notice.messages]
                assert name != "S" or shown is None or any(told), f"the window shows: {refused}"
                found[name] = Cell(None, (one_line(refused),))
                continue
        words = tuple(
            str(each.message) for each in warned if issubclass(each.category, VolspecWarning)
        )
        # What every picture says is no reason for a difference.
        words = tuple(each for each in words if name == "S" or each not in found["S"].words)
        wanted = like.get(name)
        assert wanted is not None, f"{name} has a picture, but the window has none"
        assert codes.shape == wanted.shape, (name, codes.shape, wanted.shape)
        lens = name == "page" and focused_depth(state).focus_mm is not None
        pair = name in ("S", "session", "film") and shown_stereo(state) == "side-by-side"
        off = np.sort(abs(codes - wanted).max(-1), axis=None)
        lens = lens and bool(off.mean() <= 1)
        most = MAX_LENS_CODES if lens else MAX_PAIR_CODES if pair else MAX_CODES
        if name == "page" and state.relight.viewing.display.mark:
            off = off[: off.size - int(MAX_AT_BORDER * off.size)]
        found[name] = Cell(int(off[-1]), words, most)
    return found


def _expected(state: ViewState, shown: Codes, folder: Path) -> dict[str, Codes]:
    """Return what the writers should write, by their names.

    A scene and its like have one side of a comparison and one eye, and say so. Annotations lie over
    the window's picture; EXR, scripts, which say so, and a page's file have none.
    """
    eye = replace(state.interface, stereo="")
    one_side, bare = replace(state, other=None), replace(state, other=None, interface=eye)

    def of(other: ViewState) -> Codes:
        with warnings.catch_warnings(action="ignore"):
            return _picture(other, folder)

    whole = of(state) if state.annotations else shown
    one = of(bare) if left_out(state) or state.annotations else shown
    unmarked = of(replace(bare, annotations=())) if state.annotations else one
    film = of(one_side) if left_out(state) else whole
    likes = {"S": whole, "copied": whole, "session": whole, "film": film}
    return {
        **dict.fromkeys(WRITERS, one),
        "EXR": unmarked,
        "page": unmarked,
        "script": unmarked,
        **likes,
    }


@contextmanager
def studio(folder: Path, browser: Any = None) -> Iterator[tuple[Studio, dict[str, Path]]]:
    """Yield a studio in a folder, with pages if there is a browser, and its documents by name."""
    paths = write_documents(folder)
    size = SIZE[0], SIZE[1] + BARS
    with HeadlessViewer(paths["curve"], folder, size) as viewer:
        yield Studio(folder, viewer, browser and browser.new_page()), paths


def opened(studio: Studio, path: Path) -> ViewState:
    """Return the state of a document that is opened, without panels."""
    studio.viewer.open(path)
    studio.viewer.edit(without_panels)
    studio.viewer.rest()
    return studio.viewer.state


def main(names: list[str]) -> None:
    """Print the table of each context: all settings, or those that are named."""
    rows = {"nothing": _nothing, **EDITS}
    said: Counter[str] = Counter()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        browser = None if missing() else stack.enter_context(chromium())
        made, paths = stack.enter_context(studio(folder, browser))
        writers = [name for name in WRITERS if name != "page" or browser is not None]
        counts: Counter[bool] = Counter()
        for context, (document, before) in CONTEXTS.items():
            if {*names} & {*CONTEXTS} and context not in names:
                continue
            base = applied(before, opened(made, paths[document]))
            print(f"\n{context:36}" + "".join(f"{name:>12}" for name in writers))
            for path, edit in rows.items():
                if {*names} & {*rows} and path not in names:
                    continue
                try:
                    state = applied(edit, base)
                except VolspecError as refused:
                    print(f"{path:36} no such state: {one_line(refused)}")
                    continue
                cells = tried(made, state, writers)
                texts = [
                    f"{'refused' if cell.codes is None else cell.codes}{'*' if cell.words else ''}"
                    f"{'' if cell.agrees else ' !'}"
                    for cell in cells.values()
                ]
                print(f"{path:36}" + "".join(f"{text:>12}" for text in texts), flush=True)
                counts.update(cell.agrees for cell in cells.values())
                said.update(
                    f"{name}: {text}" for name, cell in cells.items() for text in cell.words
                )
    print(f"\n{counts[True]} of {counts.total()} agree or say (*) why not, in these lines:")
    for text, count in sorted(said.items()):
        print(f"{count:5} {text}")


if __name__ == "__main__":
    main(sys.argv[1:])
