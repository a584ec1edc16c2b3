"""What the probe tells of a pixel, and the error map beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from volspec.errors import RelightError
from volspec.pipeline import raycast
from volspec.raycast import Camera, CoefficientImage
from volspec.relight import Illumination, LightRig
from volspec.relight.error_map import error_map
from volspec.spectra import colour_matching_functions
from volspec.viewer.model.document import Document
from volspec.viewer.model.light_rows import rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.probe import place_mm, read, spectra, value_at

MIDDLE = (16, 16)


def shot(state: ViewState) -> tuple[Camera, CoefficientImage, LightRig]:
    document = state.document
    camera = state.view.camera(document.volume)
    rig = rig_of(state.lights)
    assert rig is not None
    return camera, raycast(document.volume, document.transfer, camera, (33, 33)), rig


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_probe_says_where_a_ball_is_hit(
    state: ViewState, document: Document, orthographic: bool
) -> None:
    """The middle of the picture is hit on the near side, on the camera's axis."""
    state = replace(state, view=replace(state.view, orthographic=orthographic))
    camera, image, rig = shot(state)
    volume = document.volume
    told = dict(read(image, camera, volume, rig, state.relight, MIDDLE, (1, 2, 3)).rows)
    assert {"Value", "mm", "RGB", "XYZ", "J  C  h", "Q  M  s", "H", "ΔE00"} == set(told)
    assert told["RGB"] == "1  2  3"
    place = place_mm(image, camera, MIDDLE)
    assert place is not None
    centre = volume.corners_mm.mean(axis=0)
    away = np.subtract(camera.position_mm, centre)
    nearer = place - centre
    assert 0 < nearer @ away / np.linalg.norm(away) < 4.0
    # 8-voxel ball: within a tenth of a voxel of the axis.
    off = nearer - (nearer @ away) / (away @ away) * away
    assert np.linalg.norm(off) < 0.1
    assert place_mm(image, camera, (0, 0)) is None


def test_a_value_is_that_of_the_nearest_voxel(document: Document) -> None:
    volume = document.volume
    at = (volume.world_from_index @ [3.3, 4.4, 2.1, 1.0])[:3]
    assert value_at(volume, at) == volume.values[2, 4, 3]
    assert value_at(volume, at + 100.0) is None


def test_the_reflected_spectrum_has_the_colour_that_is_told(state: ViewState) -> None:
    """Q times the spectrum is the exact picture's XYZ, as both synthesise the same channels."""
    _, image, rig = shot(state)
    seen = replace(state.relight, mode="exact")
    light, reflected = spectra(image, rig, seen, MIDDLE)
    Q = colour_matching_functions(image.basis.grid)
    XYZ = 100.0 * (Q @ reflected) / (Q[1] @ light)
    lit = Illumination.of(image.basis, rig, seen, image.groups)
    x, y = MIDDLE
    wanted = lit.scene_XYZ(image.coefficients[y, x], image.alpha[y, x])
    # Negative powers of the synthesis are not drawn: a few thousandths of the white.
    np.testing.assert_allclose(XYZ, wanted, atol=0.3)
    assert light.max() == pytest.approx(1.0)


def test_nothing_but_the_backdrop_is_reflected_beside_the_ball(state: ViewState) -> None:
    _, image, rig = shot(state)
    light, reflected = spectra(image, rig, state.relight, (0, 0))
    np.testing.assert_allclose(reflected, 0.2 * light)


def test_the_probe_has_the_error_maps_figure(state: ViewState) -> None:
    camera, image, rig = shot(state)
    reading = read(image, camera, state.document.volume, rig, state.relight, MIDDLE, (0, 0, 0))
    whole = error_map(image, rig, state.relight.mode, state.relight.backdrop)
    assert dict(reading.rows)["ΔE00"] == f"{whole.delta_e[16, 16]:.2f} to exact"
    exact = replace(state.relight, mode="exact")
    told = read(image, camera, state.document.volume, rig, exact, MIDDLE, (0, 0, 0)).rows
    assert "ΔE00" not in dict(told)


def test_the_map_is_made_once_for_a_picture_and_light_and_says_where_none_shines(
    state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    from volspec.viewer.work import error_map as heat

    _, image, _ = shot(state)
    begun = []
    monkeypatch.setattr(heat.Tasks, "start", lambda self, kind, task: begun.append(task))
    overlay: Any = heat.ErrorMapTexture(None, lambda: None)
    for lights in (state.lights, state.lights, state.lights[1:], state.lights[1:]):
        overlay.want(image, lights, state.relight)
    shining, dark = begun
    assert shining()[0].delta_e.shape == (33, 33) and shining()[1] is image
    with pytest.raises(RelightError, match="No light is on"):
        dark()
