"""The page's arithmetic against the desktop's: lights, whites, matrices, transforms, looks, ΔE."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.fixtures import slow
from volspec.appearance import Viewing
from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.models import APPEARANCE_MODELS
from volspec.appearance.models.cam import CamTransform
from volspec.appearance.models.lab import delta_E_2000
from volspec.appearance.scene_to_display import CLOSED, view_transform
from volspec.appearance.spec import Display
from volspec.appearance.transforms import CurveTransform, LinearTransform
from volspec.basis import MODES, MaterialBasis, SpectralBasis
from volspec.basis.materials import Basis
from volspec.export.page import payload
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.scene.tables.lights import NamedLight
from volspec.spectra import light, reflectance
from volspec.viewer.model.light_rows import LightRow, light_rig
from volspec.viewer.model.lights import dial_place, dial_weights

NAMES = ("D65", "A", "FL2", "HP1", "planck:1800", "FL11")
# Both sides compute in double precision; sums of 31 terms in another order differ by 1e-13.
TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def compute(browser: Any, web: Path) -> Any:
    """The page's own functions, called with JSON."""
    files = ("algebra", "illumination", "conditions", "view_transform", "looks", "lighting")
    code = "\n".join((web / f"{name}.js").read_text(encoding="utf-8") for name in files)
    page = browser.new_page()
    yield lambda expression, given: page.evaluate(
        f"(given) => {{ {code}; return given.map((x) => ({expression})(x)); }}", given
    )
    page.close()


def viewings(count: int, seed: int) -> list[RelightSpec]:
    """Looks all over the models' range."""
    rng = np.random.default_rng(seed)
    names = [*CLOSED, *ADAPTATIONS]
    made = []
    for i in range(count):
        display = Display(
            L_A=float(10 ** rng.uniform(0, 3)),
            Y_b=float(rng.uniform(5, 60)),
            surround=float(rng.choice([0.0, 0.05, 0.1, 0.2])),
        )
        viewing = Viewing(
            model=names[i % len(names)],
            illuminance_lux=float(10 ** rng.uniform(0, 5)),
            L_A=None if rng.random() < 0.5 else float(10 ** rng.uniform(-2, 4)),
            Y_b=float(rng.uniform(1, 100)),
            surround=float(rng.choice([0.0, 0.07, 0.15, 0.2])),
            D=None if rng.random() < 0.5 else float(rng.uniform(0, 1)),
            exposure=float(10 ** rng.uniform(-1, 1)),
            display=display,
        )
        if viewing.D is None and rng.random() < 0.3:
            viewing = replace(viewing, discount=True)
        made.append(RelightSpec(viewing, MODES[i % 4], float(rng.uniform(0, 1))))
    return made


def settings(basis: Basis, with_lux: bool) -> list[NamedLight]:
    """Lights of one and of two spectra, from one group and from all."""
    spectra = [light(name, basis.grid) for name in NAMES]
    lux = [(300.0,), (20.0,), (1500.0,)] if with_lux else [None] * 3
    rigs = [LightRig((s,), illuminance_lux=own) for s, own in zip(spectra[:3], lux, strict=True)]
    both = (200.0, 900.0) if with_lux else None
    rigs += [LightRig(tuple(spectra[3:5]), (1.0, 0.4), both, ("key", "sky"))]
    rigs += [LightRig((spectra[5],), (0.7,), (50.0,) if with_lux else None, ("sky",))]
    return [NamedLight(f"L{i}", "", rig.lights[0], rig) for i, rig in enumerate(rigs)]


def basis_of(kind: str) -> Basis:
    materials = {name: reflectance(name) for name in ("copper", "iron", "gold")}
    if kind == "general-7":
        return SpectralBasis.load(kind)
    if kind == "fitted":
        return SpectralBasis.fit([*map(light, NAMES)], list(materials.values()), 3, "pca")
    dyes = {"dye": reflectance("fluorophore:EGFP*0.5+grey:0.4*0.5"), "iron": materials["iron"]}
    return MaterialBasis(materials) if kind == "materials" else MaterialBasis(dyes, kind)


KINDS = ("general-7", "materials", "fitted", "fluorescent")
FIRST = {
    ("general-7", False, None),
    ("materials", True, None),
    ("fluorescent", True, "longpass:510"),
}


def close(ours: Any, theirs: NDArray[Any], what: str) -> None:
    got, wanted = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    assert got.shape == wanted.shape, what
    scale = max(float(np.abs(wanted).max()), 1e-3)
    worst = float(np.abs(got - wanted).max()) / scale
    assert worst <= TOLERANCE, f"{what}: {worst:.2e}\n{got}\n{wanted}"


@pytest.mark.parametrize(
    ("kind", "with_lux", "through"),
    [
        row if row in FIRST else slow(*row)
        for row in product(KINDS, (False, True), (None, "longpass:510"))
    ],
)
def test_lights_become_the_desktops_matrices(compute, kind, with_lux, through):
    basis = basis_of(kind)
    shares = {"key": 0.75, "sky": 0.25}
    lights = settings(basis, with_lux)
    rng = np.random.default_rng(3)
    given, wanted = [], []
    for seen in viewings(60, 1):
        weights = rng.uniform(0, 1, 5) * (rng.random(5) < 0.6)
        rig = light_rig(
            tuple(LightRow(x.name, "", x.rig, w) for x, w in zip(lights, weights, strict=True))
        )
        if rig is None:
            continue
        if with_lux and rng.random() < 0.5:
            seen = RelightSpec(seen.viewing, seen.mode, seen.backdrop, "absolute")
        seen = replace(seen, filter=through)
        wanted.append(Illumination.of(basis, rig, seen, shares))
        look = payload.look_numbers(seen, lights) | {"weights": weights.tolist()}
        given.append(look)
    numbers = {
        "basis": payload.basis_numbers(basis, seen.seen_through(basis.grid)),
        "lights": [
            payload.light_numbers(each, basis, seen.seen_through(basis.grid)) for each in lights
        ],
        "groups": shares,
    }
    got = compute(
        "([n, look]) => illuminationOf(n.basis, n.groups, rigOf(n.lights, look.weights), look)",
        [[numbers, look] for look in given],
    )
    assert len(got) > 40
    for ours, theirs in zip(got, wanted, strict=True):
        close(ours["matrix"], theirs.XYZ_from_channels, "matrix")
        close(ours["white"], theirs.white_XYZ, "white")
        close(ours["backdrop"], theirs.backdrop_XYZ, "backdrop")
        assert (ours["lux"] is None) == (theirs.illuminance_lux is None)
        close(ours["lux"] or 0.0, np.float64(theirs.illuminance_lux or 0.0), "lux")


def test_view_transforms_are_the_desktops(compute):
    lights = settings(SpectralBasis.load("general-7"), False)
    whites = [[95.0, 100.0, 108.9], [109.85, 100.0, 35.58], [128.0, 100.0, 4.0], [95, 100, 0.0]]
    seen = viewings(160, 2)
    numbers = payload.constants()
    given = [
        [
            numbers,
            payload.look_numbers(each, lights),
            whites[i % 4 if each.viewing.model != "RLAB" else i % 3],
            payload.page_viewing(each.viewing)["display"],
        ]
        for i, each in enumerate(seen)
    ]
    got = compute(
        "([k, look, white, display]) => viewTransform(k, look, white, null, display)", given
    )
    for ours, each, (_, _, white, _) in zip(got, seen, given, strict=True):
        theirs = view_transform(each.viewing, white)
        model = each.viewing.model
        if isinstance(theirs, LinearTransform):
            close(ours["matrix"], theirs.matrix, model)
            continue
        names = {
            CurveTransform: ("gain", "power", "shift", "offset", "outer"),
            CamTransform: (
                *("scene_achromatic", "display_achromatic", "lightness_power", "chroma_gain"),
            ),
        }[type(theirs)]
        for name in ("response_from_XYZ", "XYZ_from_response", *names):
            close(ours[name], getattr(theirs, name), f"{model}.{name}")


def test_the_probe_reads_the_desktops_look(compute):
    rng = np.random.default_rng(5)
    lights = settings(SpectralBasis.load("general-7"), False)
    white = np.array([109.85, 100.0, 35.58])
    seen = viewings(80, 4)
    colours = white * rng.uniform(0.0, 1.0, (80, 3)) ** 2
    given = [
        [payload.constants(), payload.look_numbers(each, lights), white.tolist(), colour.tolist()]
        for each, colour in zip(seen, colours, strict=True)
    ]
    got = compute(
        "([k, look, white, XYZ]) => lookOf(k, XYZ, sceneConditions(look, white, null), look.model)",
        given,
    )
    compared = 0
    for ours, each, colour in zip(got, seen, colours, strict=True):
        name = each.viewing.model if each.viewing.model in APPEARANCE_MODELS else "CIECAM02"
        theirs = APPEARANCE_MODELS[name].forward(colour, each.viewing.conditions(white))
        assert (ours is not None) == bool(theirs.defined), (name, colour)
        if ours is None:
            continue
        compared += 1
        for key in ("J", "C", "h", *(("Q", "M", "s") if theirs.Q is not None else ())):
            close(ours[key], np.asarray(getattr(theirs, key)), f"{name} {key}")
    assert compared > 40


def test_colour_differences_are_the_desktops(compute):
    rng = np.random.default_rng(6)
    one = rng.uniform((0, -90, -90), (100, 90, 90), (300, 3))
    # No hues exactly opposite: which way round they are averaged is the last digit's.
    other = np.where(rng.random((300, 1)) < 0.5, one + rng.normal(0, 2, (300, 3)), one[::-1])
    other[:3] = [[50, 0, 0], [0, 0, 0], one[2]]
    got = compute("([a, b]) => deltaE2000(a, b)", np.stack([one, other], 1).tolist())
    close(got, delta_E_2000(one, other), "CIEDE2000")


def test_the_dial_blends_as_the_viewers(compute):
    rng = np.random.default_rng(7)
    places = [[n, *rng.uniform(-1.2, 1.2, 2).tolist()] for n in range(1, 9) for _ in range(12)]
    got = compute("([n, x, y]) => dialWeights(n, x, y)", places)
    back = compute("(weights) => dialPlace(weights)", got)
    for (n, x, y), weights, place in zip(places, got, back, strict=True):
        close(weights, np.array(dial_weights(n, x, y)), f"{n} lights at {x}, {y}")
        close(place, np.array(dial_place(weights)), f"{n} lights back")
