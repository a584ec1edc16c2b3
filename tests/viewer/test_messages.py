"""Messages of edits and texts of panels, as the golden file has them.

``python -m tests.viewer.test_messages`` writes the file again; read the difference.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.viewer import (
    curve_of,
    of_kind,
    report_of,
    run_command,
    small_document,
    table_with,
)
from volspec.errors import VolspecError, one_line
from volspec.palette import Cell
from volspec.pipeline import raycast
from volspec.raycast import Ambient, LightGroup
from volspec.raycast.spec import MAX_GROUPS
from volspec.relight import LightRig, RelightSpec
from volspec.relight.difference_maps import ErrorMap
from volspec.scene.tables.annotation import Annotation
from volspec.spectra import DEFAULT_GRID, Spectrum, light
from volspec.transfer import Region, TransferFunction2D
from volspec.viewer.model import light_parts, lighting, lights, materials, measure, opacities, room
from volspec.viewer.model.edit import Edited
from volspec.viewer.model.light_rows import MAX_ROWS, LightRow, LightState, lux_note
from volspec.viewer.model.light_states import MAX_STATES
from volspec.viewer.model.palette_table import colour_table
from volspec.viewer.model.palette_targets import STAY
from volspec.viewer.model.paths import check_name
from volspec.viewer.model.scene_file import scene_from_state
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_convert import conversion_losses
from volspec.viewer.ui.context import Results, UiContext
from volspec.viewer.ui.lights_library import verdict
from volspec.viewer.ui.lights_panel import row_tip
from volspec.viewer.ui.menus import sizes, timings
from volspec.viewer.ui.overlays import error_map_lines
from volspec.viewer.ui.palette_cells import cell_lines, column_note
from volspec.viewer.ui.palette_panel import summary
from volspec.viewer.work.outputs import Progress
from volspec.viewer.work.screenshot import copy_values, render_frame
from volspec.volume.series import series_address

pytestmark = pytest.mark.not_quick

GOLDEN = Path(__file__).with_name("messages.txt")
RED = Cell(colour=(1, 0, 0))
LABEL = Annotation(points_mm=((0.0, 0.0, 0.0),), text="here")
GLASS = {"copper": Spectrum([390, 710], [0.2, 0.9])}


def test_messages_are_those_of_the_golden_file(state):
    assert transcript(state).splitlines() == GOLDEN.read_text(encoding="utf-8").splitlines()


def transcript(state: ViewState) -> str:
    """Return the texts of each part with its title."""
    parts: tuple[Callable[[ViewState], Iterator[str]], ...] = (
        _refusals,
        _lights,
        _transfer,
        _materials,
        _cells,
        _overlays,
        _errors,
    )
    return "\n\n".join("\n".join((f"# {f.__name__[1:]}", *f(state))) for f in parts) + "\n"


def _refusals(state: ViewState) -> Iterator[str]:
    """Messages of edits that change nothing."""
    full = replace(state, lights=state.lights[:1] * MAX_ROWS)
    dark = replace(state, lights=(replace(state.lights[0], weight=0.0),))
    saved = tuple(LightState(str(i), state.lights, state.relight) for i in range(MAX_STATES))
    surfaces = of_kind(state, "surfaces")
    exact = opacities.set_opacity(state, "gold", 0.5)
    for given, name in (
        *((full, "keep-mix"), (full, "palette-light"), (dark, "keep-mix"), (dark, "remove-light")),
        *((replace(state, saved_lights=saved), "save-state"), (state, "palette-restart")),
        *((state, "transfer-labels"), (run_command(state, "p").state, "plane-facing")),
        *((state, "panel-room"), (state, "reset-paints")),
        *((surfaces, "projection-average"), (surfaces, "preintegration")),
        (replace(exact, shading=replace(exact.shading, mode="maximum")), "stereo-anaglyph"),
    ):
        new, message, _ = run_command(given, name)
        assert new is given
        yield f"{name}: {message}"
    sky = lighting.add_source(state, "sky").state
    groups = state
    while len(groups.shading.groups) < MAX_GROUPS:
        groups = lighting.add_source(groups, "headlight").state
    shading = replace(state.shading, groups=(LightGroup("light", (Ambient(),)),))
    measured = replace(measure.start(state, "label"), annotations=(LABEL,) * measure.MAX_POINTS)
    rows: list[tuple[ViewState, Callable[..., Edited], tuple[Any, ...]]] = [
        (groups, lighting.add_source, ("sky",)),
        (sky, lighting.rename_group, (1, "a=b")),
        (replace(state, shading=shading), lighting.remove_source, (0,)),
        (measured, measure.pick, ((0.0, 0.0, 0.0),)),
        *((state, materials.add_material, (0, name)) for name in ("gould", "no.csv", "grey:7")),
        *((state, lights.add, (name,)) for name in ("D65*0.7+Q*0.3", "no.csv")),
        *((state, light_parts.respell, (0, 0, name)) for name in ("D6", "no.csv")),
    ]
    for given, edit, arguments in rows:
        new, message, _ = edit(given, *arguments)
        assert new is given
        yield f"{edit.__name__}: {message}"
    yield room.LIGHTS


def _lights(state: ViewState) -> Iterator[str]:
    bright, shares = light_parts.set_lux(state, 0, 500.0), {"all": 1.0}
    both = lights.set_weight(bright, 1, 1.0)
    for rows, level in ((bright, "relative"), (both, "relative"), (state, "relative")):
        yield lux_note(rows.lights, shares, RelightSpec(level=level))
    yield lux_note(both.lights, shares, RelightSpec(level="absolute"))
    yield row_tip(light_parts.draw(state, 0, 0, (0.1, 2.0), (0.5, 2.0)).lights[0])
    pair, groups = (light("A"), light("D65")), ("room", "sky")
    yield column_note(LightRow("x", "", LightRig(pair, groups=groups), texts=("A", None)))
    yield column_note(LightRow("x", "", LightRig(pair, (1.0, 0.0)), texts=("A", "D65")))
    yield column_note(LightRow("x", "", LightRig(pair[:1], groups=("sky",))))


def _transfer(state: ViewState) -> Iterator[str]:
    curve = curve_of(state)
    yield conversion_losses(replace(curve, filters=GLASS), "regions", (0.0, 1.0))
    gradients = replace(curve, gradient_opacity=((0.0, 0.0), (0.4, 1.0)))
    yield conversion_losses(gradients, "surfaces", (0.0, 1.0))
    regions = [Region((i, i + 0.5), (0.1, 1.0), 0.5, "gold") for i in range(12)]
    many = TransferFunction2D(regions, curve.materials, curve.basis)
    yield conversion_losses(many, "surfaces", (0.0, 12.0))


def _materials(state: ViewState) -> Iterator[str]:
    for before in (state, replace(state, transfer=replace(curve_of(state), filters=GLASS))):
        new = materials.add_material(before, 0, "silver").state
        yield materials.material_message(before.transfer, new.transfer)
    for kind in ("points", "regions", "surfaces", "labels"):
        yield materials.uses_of_material(of_kind(state, kind).transfer, "gold")
    points = [(0.1 * i, 0.1, "gold") for i in range(9)]
    yield materials.uses_of_material(replace(curve_of(state), points=points), "gold")


def _cells(state: ViewState) -> Iterator[str]:
    for cell, error in (
        *((RED, 0.4), (RED, 7.0), (Cell(colour=(1, 0, 0), weight=STAY), 0.2)),
        *((Cell("free", group="metals"), 0.2), (Cell("black"), 0.2)),
        *((Cell(kind, other=("tin", "D65")), 0.2) for kind in ("same", "distinct")),
    ):
        yield cell_lines(report_of(cell, error), cell)
    yield cell_lines(report_of(inside=False), None)
    yield summary(colour_table(state))
    for errors in ((STAY, 0.2), (STAY, 6.0), (4.0, 6.0)):
        yield summary(table_with((1.0, 0.3), errors))


def _overlays(state: ViewState) -> Iterator[str]:
    whole = np.ones((2, 2), np.float32)
    for found in (None, ErrorMap(0.5 * whole, whole), ErrorMap(3 * whole, whole)):
        yield from error_map_lines(found, "")
    document = state.document
    camera = state.view.camera(document.volume)
    coarse = Results(raycast(document.volume, document.transfer, camera, (40, 30)))
    for results in (Results(), Results(fault="no"), coarse, replace(coarse, sharp=True)):
        yield sizes(state, UiContext(results=results))
    yield timings(UiContext(results=Results(fps=59.9, ms={"cast": 12.3})))


def _errors(state: ViewState) -> Iterator[str]:
    """Messages of refused files, notations and copies."""
    dark = replace(state, lights=(replace(state.lights[0], weight=0.0),))
    for call in (
        lambda: series_address(["/a/x.nrrd", "/b/y.nrrd"]),
        lambda: check_name("/a/caf\udce9.npy"),
        lambda: scene_from_state(state),
        lambda: render_frame(dark, (8, 8), Progress("")),
        lambda: copy_values(None),
    ):
        with raises(VolspecError) as caught:
            call()
        yield one_line(caught.value)
    for text in ("D65*0.7+Q*0.3", "daylight:62", "lamp.csv"):
        yield verdict(text, DEFAULT_GRID, ".")[1]


if __name__ == "__main__":
    start = ViewState.first(small_document(), (160, 120))
    GOLDEN.write_text(transcript(start), encoding="utf-8")
