"""Build the viewer's states without a window, and run its commands."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tests.support.patience import wait_until
from volspec.basis import SpectralBasis
from volspec.basis.display import DEFAULT_MODE, Mode
from volspec.palette import Cell, CellReport, design
from volspec.pipeline import raycast, relight
from volspec.raycast import RaycastSpec
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene
from volspec.spectra import light, reflectance
from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.viewer.model import palette_edits
from volspec.viewer.model.commands import BY_KEY, BY_NAME
from volspec.viewer.model.document import Document
from volspec.viewer.model.edit import Edited, after
from volspec.viewer.model.fields import shown_transfer
from volspec.viewer.model.light_rows import LightRow, light_rig
from volspec.viewer.model.palette_table import PaletteTable, palette_from_state, with_design
from volspec.viewer.model.quality import cast_spec
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import View
from volspec.volume import phantom

T = TypeVar("T")


def run_command(state: ViewState, command: str) -> Edited:
    """Return the state after a command, by its name or key, and the command's message."""
    change = (BY_NAME.get(command) or BY_KEY[command]).change
    assert change is not None
    return after(change, state)


def take_until(take: Callable[[], list[T]], ended: Callable[[list[T]], object]) -> list[T]:
    """Return what comes until a condition on all of it holds."""
    found: list[T] = []

    def done() -> object:
        found.extend(take())
        return ended(found)

    wait_until(done)
    return found


def curve_of(state: ViewState) -> TransferFunction:
    """Return the state's transfer function, which is a curve."""
    assert isinstance(state.transfer, TransferFunction)
    return state.transfer


HEAD = """
# A remark of the author's.
title = "ball"
version = 2
[volume]
file = "ball.npy"
[[material]]
name = "copper"
reflectance = "copper"  # a metal
[[material]]
name = "grey"
reflectance = "grey:0.5"
[transfer]
%s
[basis]
%s
[[light]]
name = "day"
label = "daylight"
spectrum = "D65"
[[light]]
name = "tungsten"
spectrum = "A"
[viewing]
backdrop = 0.1
"""
SCENES = {
    "points": """points = [
    { value = 0.2, opacity = 0.0, material = "copper" },
    { value = 0.9, opacity = 0.4, material = { copper = 0.5, grey = 0.25 } },
]""",
    "gradients": """points = [
    { value = 0.2, opacity = 0.1, material = "copper" },
    { value = 0.9, opacity = 0.4, material = "grey" },
]
gradient_opacity = [[0.0, 0.1], [0.3, 1.0]]""",
    "regions": """regions = [
    { values = [0.3, 0.9], gradients = [0.0, 0.5], opacity = 0.5, material = "copper" },
]
reference_step_mm = 0.7""",
    "open regions": """regions = [
    { values = [0.3, 0.9], gradients = [0.01, inf], opacity = 0.5, material = "copper" },
]""",
    "labels": 'labels = [{ label = 1, opacity = 0.6, material = "grey" }]',
    "surfaces": """surfaces = [
    { value = 0.3, opacity = 0.3, material = "copper" },
    { value = 0.7, opacity = 1.0, material = "grey" },
]""",
}


def opened(folder: Path, kind: str = "points", basis: str = 'name = "general-5"') -> ViewState:
    """A small scene on disk, as the viewer opens it."""
    ball = phantom.ball(12).values
    np.save(folder / "ball.npy", (ball > 0.5).astype(np.uint8) if kind == "labels" else ball)
    path = folder / "ball.toml"
    path.write_text(HEAD % (SCENES[kind], basis), encoding="utf-8")
    return read_scene(path)


def read_scene(path: Path) -> ViewState:
    scene = Scene.load(path)
    document = Document.of(scene, scene.volume(), None)
    output = scene.file.output
    return ViewState.first(document, (output.width, output.height))


def picture(state: ViewState, mode: Mode = DEFAULT_MODE) -> NDArray[Any]:
    """Return the frame of a state, in floats."""
    volume = state.document.volume
    transfer, camera = shown_transfer(state), state.view.camera(volume)
    image = raycast(volume, transfer, camera, state.size, cast_spec(state))
    rig = light_rig(state.lights)
    assert rig is not None
    return relight(image, rig, replace(state.relight, mode=mode), dtype=np.float32, backend="numpy")


def assert_same_picture(state: ViewState, folder: Path) -> ViewState:
    """Write, read, compare: lights that are scaled again differ in the last of float32's digits.

    A mix is written as one light, which has a fitted matrix of its own: measured 4e-5.
    """
    again = read_scene(export_scene(replace(state, size=(40, 30)), folder / "again.toml"))
    modes: tuple[tuple[Mode, float], ...] = (("exact", 2e-6), (DEFAULT_MODE, 1e-4))
    for mode, most in modes:
        one, other = (picture(each, mode) for each in (replace(state, size=(40, 30)), again))
        assert one.std() > 0.01
        np.testing.assert_allclose(one, other, atol=most)
    return again


def assert_same_tables(one: ViewState, other: ViewState) -> None:
    """Assert that two states are cast alike, by what a kernel gets: another kind needs its own."""
    tables = [each.transfer.bake(1.0) for each in (one, other)]
    for name in ("opacity", "channels"):
        np.testing.assert_array_equal(*(getattr(table, name) for table in tables))
    assert cast_spec(one) == cast_spec(other)


KINDS = ("points", "regions", "surfaces", "labels")


def of_kind(state: ViewState, kind: str) -> ViewState:
    """The state of a scene with a transfer function of a kind."""
    materials, basis = state.transfer.materials, state.transfer.basis
    made: dict[str, Callable[[], Transfer]] = {
        "points": lambda: state.transfer,
        "regions": lambda: TransferFunction2D(
            [
                Region((0.2, 0.5), (0.0, math.inf), 0.1, "copper"),
                Region((0.5, 1.0), (0.02, 0.1), 0.5, "gold"),
            ],
            materials,
            basis,
        ),
        "surfaces": lambda: Isosurfaces(
            [(0.3, 0.2, "copper"), (0.8, 1.0, "gold")], materials, basis
        ),
        "labels": lambda: LabelFunction({1: (0.2, "copper"), 7: (1.0, "gold")}, materials, basis),
    }
    document = replace(state.document, transfer=made[kind]())
    return replace(state, document=document, transfer=document.transfer)


# ΔE00 just visible side by side: the limit for a reached target.
VISIBLE = 1.0


def with_target(state: ViewState, place: int, colour: str = "#8c5a3c") -> ViewState:
    return palette_edits.set_target(state, place, colour)


def with_designed(state: ViewState) -> ViewState:
    return with_design(state, design(palette_from_state(state)), state.palette.targets)


def small_document() -> Document:
    """Return a document without a device: a ball of two metals under four lights."""
    ball = phantom.ball(8)
    metals = {name: reflectance(name) for name in ("copper", "gold")}
    points = [(0.2, 0.0, "copper"), (0.5, 0.2, "copper"), (0.9, 0.6, "gold")]
    rows = [LightRow(n, n, LightRig((light(n),)), float(n == "D65")) for n in ("D65", "A", "FL2")]
    planck = LightRow("3000 K", "", LightRig((light("planck:3000"),)), kelvin=3000.0)
    return Document(
        title="ball",
        volume=ball,
        caster=None,
        view=View(),
        transfer=TransferFunction(points, metals, SpectralBasis.load("general-7")),
        shading=RaycastSpec(),
        lights=(*rows, planck),
        relight=RelightSpec(),
    )


def report_of(
    target: Cell | None = None, error: float | None = None, inside: bool = True
) -> CellReport:
    """Return the report of a cell of gold under A."""
    colour, XYZ = (0.5, 0.4, 0.3), (20.0, 18.0, 10.0)
    kind, weight = (target.kind, target.weight) if target else ("colour", 1.0)
    return CellReport("gold", "A", kind, weight, colour, colour, XYZ, error, error, inside)


def table_with(*errors: tuple[float, float]) -> PaletteTable:
    """Return a table of cells with (weight, error)."""
    cells = {
        (f"{i}", "A"): report_of(Cell(colour=(1, 0, 0), weight=weight), error)
        for i, (weight, error) in enumerate(errors)
    }
    return PaletteTable((), ("A",), {}, cells)
