"""A document without a device, as the pure parts of the viewer see it; a screen for the window."""

from __future__ import annotations

import pytest

from benchmarks.robot import missing
from volspec.basis import SpectralBasis
from volspec.raycast import RaycastSpec
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import light, reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model.document import Document, histogram
from volspec.viewer.model.light_rows import LightRow
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import View
from volspec.volume import phantom


@pytest.fixture(scope="session")
def document() -> Document:
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
        histogram=histogram(ball),
    )


@pytest.fixture(scope="session")
def state(document: Document) -> ViewState:
    return ViewState.first(document, (160, 120))


@pytest.fixture(scope="session")
def screen() -> None:
    """Skip, and say why, where no display can be made for a window."""
    if lacking := missing():
        pytest.skip(lacking)
