"""Figures of adaptation, appearance models and viewing."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache, partial

import numpy as np

from benchmarks.claims.model import (
    CLAIMS,
    ROOT,
    Array,
    Claim,
    Figures,
    claim,
    mean_and_most,
    shown_difference,
)
from tests.appearance import test_deficiency
from tests.appearance._models import CONDITIONS, apart, colours
from tests.support.relight_reference import relight_reference
from tests.support.relighting import surfaces
from tests.twins.test_relight_field import patches
from tools import breneman
from volspec.appearance import Display, Viewing, ViewingConditions, view_transform
from volspec.appearance.adaptation import adapt, nonlinear
from volspec.appearance.adaptation_grid import AdaptationGrid, pixels_from_nodes
from volspec.appearance.display.deficiency import simulation
from volspec.appearance.display.monitors import preset
from volspec.appearance.display.spaces import SPACES, ColourSpace, Transfer
from volspec.appearance.gamut_mapping import DisplayGamut, DisplayOutput, reduce_chroma
from volspec.appearance.lut3d import Lut3D, LutSpace
from volspec.appearance.measured import measured_conditions
from volspec.appearance.models import APPEARANCE_MODELS, cam, model
from volspec.appearance.models.cam import CamConditions
from volspec.appearance.models.numeric import invert
from volspec.relight import Illumination, Relighter, RelightSpec
from volspec.relight.measured_viewing import ViewingMeter
from volspec.scene import Scene
from volspec.spectra import (
    PAPERS_GRID,
    Spectrum,
    XYZ_from_spectra,
    light,
    reflectance_set,
    white_XYZ,
)
from volspec.spectra.datasets import colour_science

# Adaptation.


def breneman_mean(method: str, Y_b: float = breneman.Y_B) -> float:
    """Return 1000 Δu'v', the mean of all experiments, on a background."""
    found = []
    for each in breneman.experiments():
        ends = (replace(e, Y_b=Y_b, L_A=each.Y_n * Y_b / 100.0) for e in (each.source, each.target))
        predicted = breneman.uv_from_XYZ(adapt(each.XYZ, *ends, method))
        found.append(np.linalg.norm(predicted - each.matched, axis=-1))
    return 1000.0 * float(np.mean(found))


@claim("adaptation.md", "Nayatani's depends on the background: {} at Y_b = 20, {} at 18;")
def nayatani_by_background() -> Figures:
    return [breneman_mean("Nayatani", Y_b) for Y_b in (20.0, 18.0)]


@claim("adaptation.md", "the adapting light: {}, {} and {} at k_2 = 1, 15 and 50")
def guth_by_strength() -> Figures:
    own, found = nonlinear.GUTH_ADAPTING, []
    try:
        for nonlinear.GUTH_ADAPTING in (1.0, 15.0, 50.0):
            found.append(breneman_mean("Guth"))
    finally:
        nonlinear.GUTH_ADAPTING = own
    return found


@claim("adaptation.md", "and cd/m² where lux are: {} instead of {} (")
def colour_science_s_CIE_1994() -> Figures:
    predict = colour_science().corresponding.corresponding_chromaticities_prediction_CIE1994
    pairs = [each for number in breneman.EXPERIMENTS for each in predict(number)]
    off = np.linalg.norm([each.uv_p - each.uv_m for each in pairs], axis=-1)
    return [1000.0 * float(off.mean()), breneman_mean("CIE 1994")]


# Appearance by LUT.


def lut_errors(viewing: Viewing, lamp: Spectrum, XYZ: Array | None = None) -> Array:
    """Return CIEDE2000 of what a LUT draws: by default of the sRGB gamut, moved to the white."""
    white = white_XYZ(lamp)
    XYZ = surfaces(white).reshape(-1, 3) if XYZ is None else XYZ
    space, transform = viewing.display.colours, view_transform(viewing, white)
    table = Lut3D.of(transform, LutSpace.between(white, space))
    looked_up, exact = (each.apply(XYZ) for each in (table, transform))
    drawn = np.any(looked_up != exact, axis=-1)  # the others are drawn by the closed form
    return shown_difference(
        *(each[drawn] @ space.RGB_from_XYZ.T for each in (looked_up, exact)), space
    )


@claim(
    "appearance.md",
    "CIECAM02 by LUT is off by CIEDE2000 {} on average and {} at most under tungsten, {} and {} "
    "under FL2, {} and {} under high-pressure sodium",
)
def ciecam02_by_lut() -> Figures:
    return [
        x for name in ("A", "FL2", "HP1") for x in mean_and_most(lut_errors(Viewing(), light(name)))
    ]


@claim("appearance.md", "by {} at most in five viewings")
def blocks_by_lut() -> Figures:
    bands = np.arange(PAPERS_GRID.size)
    ends = [(a, b) for a in bands for b in range(a + 1, len(bands) + 1)]
    own = np.array([(a <= bands) & (bands < b) for a, b in ends], dtype=np.float64)
    cinema = preset("cinema").display(space="DCI-P3")
    found = []
    for name, viewing in (
        ("D65", Viewing()),
        ("HP1", Viewing(model="CAM16")),
        ("A", Viewing(display=cinema)),
        ("D65", Viewing(Y_b=1.0)),
        ("A", Viewing(model="Guth", exposure=3.0)),
    ):
        lamp = light(name, PAPERS_GRID)
        XYZ = viewing.exposure * XYZ_from_spectra(lamp, np.vstack([own, 1.0 - own]))
        found.append(lut_errors(viewing, lamp, XYZ).max())
    return [float(max(found))]


@claim(
    "appearance.md",
    "off by {} on average and {} at most (Hunt), {} and {} (Nayatani 95), {} and {} (ZCAM)",
    slow=True,
)
def host_luts() -> Figures:
    found = []
    for name in ("Hunt", "Nayatani95", "ZCAM"):
        viewing = Viewing(model=name, surround=0.12)
        found.append(np.concatenate([lut_errors(viewing, light(lamp)) for lamp in ("A", "FL2")]))
    return [x for each in found for x in mean_and_most(each)]


@claim(
    "appearance.md",
    "Hunt on a display of {} cd/m² (L_A) is off by {} on average, {} at most",
    slow=True,
)
def hunt_by_lut_on_a_dark_display() -> Figures:
    viewing = Viewing(model="Hunt", display=Display(L_A=0.1))
    return [0.1, *mean_and_most(lut_errors(viewing, light("A")))]


@claim(
    "appearance.md",
    "Hunt is then off by {} ({} at most) under low-pressure sodium, Nayatani 95 by {} ({}) under "
    "450 nm",
)
def luts_under_narrow_lights() -> Figures:
    S = np.vstack([reflectance_set(each) for each in ("test", "training", "natural", "patches")])
    nm = light("D65").wavelengths_nm
    found = []
    for name, lamp in (("Hunt", light("LPS")), ("Nayatani95", Spectrum(nm, 1.0 * (nm == 450.0)))):
        found += mean_and_most(lut_errors(Viewing(model=name), lamp, XYZ_from_spectra(lamp, S)))
    return found


# Models.

ACES = ColourSpace(
    "ACES2065-1", ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077)), (0.32168, 0.33767),
    Transfer.gamma(1.0),
)  # fmt: skip


def cube() -> Array:
    """Return (17³, 3) linear RGB."""
    return np.indices((17, 17, 17)).reshape(3, -1).T / 16.0


@claim(
    "models.md",
    "of the ACES cube (17³, AP0 with its imaginary blue) {} to {} % is undefined in CIECAM02 and "
    "{} % in CAM16",
)
def undefined_of_ACES() -> Figures:
    XYZ = cube() @ ACES.XYZ_from_RGB.T
    first, second = (
        [
            100.0 * float(np.mean(~model(name).forward(XYZ, each).defined))
            for each in CONDITIONS.values()
        ]
        for name in ("CIECAM02", "CAM16")
    )
    return [min(first), max(first), max(second)]


@claim(
    "models.md",
    "this leaves {} % in CIECAM02 and CAM16, {} % in CIELAB and RLAB, {} % in Hunt, {} % in "
    "Nayatani95, {} % in Hellwig2022 and {} % in ZCAM",
)
def invertible_appearances() -> Figures:
    J, C, h = np.random.default_rng(3).uniform(0.0, (100.0, 200.0, 360.0), (60_000, 3)).T
    found = {
        name: 100.0 * np.isfinite(each.inverse(J, C, h, CONDITIONS["room under A"])).all(-1).mean()
        for name, each in APPEARANCE_MODELS.items()
    }
    return [found[name] for name in ("CIECAM02", "CIELAB", *list(found)[4:])]


@claim(
    "models.md",
    "within {} of a colour's greatest channel (CIECAM02, CAM16, CIELAB, RLAB, Hellwig2022), {} "
    "(Hunt), {} (Nayatani95) and {} (ZCAM)",
    rounding=True,
)
def round_trips() -> Figures:
    worst = dict.fromkeys(APPEARANCE_MODELS, 0.0)
    for conditions in CONDITIONS.values():
        XYZ = colours(conditions.white_XYZ)
        for name, each in APPEARANCE_MODELS.items():
            seen = each.forward(XYZ, conditions)
            back = each.invert_beyond(seen.J, seen.C, seen.h, conditions)
            worst[name] = max(worst[name], float(apart(back, XYZ).max()))
    closed = max(worst.pop(n) for n in ("CIECAM02", "CAM16", "CIELAB", "RLAB", "Hellwig2022"))
    return [closed, *worst.values()]


@claim("models.md", "it fails for {} to {} of the 80 064", slow=True)
def numeric_inverse() -> Figures:
    lost = []
    for each in APPEARANCE_MODELS.values():
        count = 0
        for conditions in CONDITIONS.values():
            seen = each.forward(colours(conditions.white_XYZ), conditions)
            back = invert(each.forward, seen.J, seen.C, seen.h, conditions)
            count += int(np.count_nonzero(~np.isfinite(back).all(axis=-1)))
        lost.append(count)
    return [min(lost), max(lost)]


@claim("models.md", "a J of {} at 1000 lx and of {} at 10 000 lx for")
def zcam_of_a_grey() -> Figures:
    return grey_J("ZCAM")


@claim("models.md", "where CAM16 has {} and {}.")
def cam16_of_a_grey() -> Figures:
    return grey_J("CAM16")


def grey_J(name: str) -> Figures:
    """Return J of a grey at 1000 and 10 000 lx, by a model."""
    whites = [ViewingConditions((95.05, 100.0, 108.88), L_A=lux / np.pi / 5) for lux in (1e3, 1e4)]
    return [float(model(name).forward([19.0, 20.0, 21.8], each).J) for each in whites]


# Viewing.


@cache
def mapped_cube() -> tuple[CamConditions, Array, Array, Array]:
    """Return sRGB's eye, and its J, C, h of the Rec. 2020 cube: own, clipped, of less chroma."""
    space = SPACES["sRGB"]
    eye = CamConditions.of(space.white_XYZ, Display().L_A, 20.0)
    XYZ = cube() @ SPACES["Rec. 2020"].XYZ_from_RGB.T
    clipped = np.clip(XYZ @ space.RGB_from_XYZ.T, 0.0, 1.0) @ space.XYZ_from_RGB.T
    looks = [cam.forward(each, eye) for each in (XYZ, clipped, reduce_chroma(XYZ, eye, space)[0])]
    return eye, *(np.array([look.J, look.C, look.h]) for look in looks)


def turned(one: Array, other: Array) -> Array:
    """Return the degrees between hues."""
    return np.abs((other[2] - one[2] + 180.0) % 360.0 - 180.0)


@claim("viewing.md", "by {}° on average and {}° at most, and lightness by up to {}")
def clipping() -> Figures:
    _, own, clipped, _ = mapped_cube()
    linear = cube() @ SPACES["Rec. 2020"].XYZ_from_RGB.T @ SPACES["sRGB"].RGB_from_XYZ.T
    outside = np.any((linear < 0.0) | (linear > 1.0), axis=-1)
    hued = outside & (own[1] > 1.0) & (clipped[1] > 1.0)
    return [*mean_and_most(turned(own, clipped)[hued]), np.abs(clipped - own)[0, outside].max()]


@claim(
    "viewing.md",
    "sees its white with some chroma ({} at sRGB's conditions), so above J = {} no colour without "
    "chroma can be shown at all. From J = {} on",
)
def the_display_s_white() -> Figures:
    space, (eye, *_) = SPACES["sRGB"], mapped_cube()
    J = np.linspace(90.0, 100.0, 1001)
    grey = cam.inverse(J, 0.0, 0.0, eye) @ space.RGB_from_XYZ.T
    knee = DisplayGamut.of(eye, space).knee / eye.white_achromatic
    highest = J[grey.max(axis=1) <= 1.0].max()
    return [cam.forward(space.white_XYZ, eye).C, highest, 100.0 * knee**eye.lightness_power]


@claim("viewing.md", "({}° on average and {}° at most where a chroma of 5 is left on that cube,")
def hue_above_the_knee() -> Figures:
    _, own, _, reduced = mapped_cube()
    knee = the_display_s_white()[2]
    pale = (own[0] > knee) & (reduced[1] > 5.0) & (np.abs(reduced - own)[1] > 1e-6)
    return mean_and_most(turned(own, reduced)[pale])


@claim("viewing.md", "the frame jumps by CIEDE2000 {} at w = {}")
def jump_of_a_blue() -> Figures:
    A, D65 = (light(name) for name in ("A", "D65"))
    nm = A.wavelengths_nm
    blue = 1.0 * ((nm >= 430.0) & (nm <= 470.0))
    viewing = Viewing(display=Display(gamut="reduce"))

    def shown(w: float) -> Array:
        E = Spectrum(nm, A.values * w + D65.values * (1.0 - w))
        XYZ = view_transform(viewing, white_XYZ(E)).apply(XYZ_from_spectra(E, blue))
        return DisplayOutput.of(viewing.display).linear(XYZ[None])[0]

    low, high = 0.0, 1.0
    for _ in range(2):  # finer around the largest step
        w = np.linspace(low, high, 101)
        steps = shown_difference(
            *(np.concatenate([shown(x) for x in each]) for each in (w[1:], w[:-1]))
        )
        low, high = w[steps.argmax() :][:2]
    return [float(steps.max()), float(low)]


def field_errors(cells: int) -> Figures:
    """Return how far maps of Y_b are from single points, on black and white patches, by angle."""
    rng = np.random.default_rng(3)
    Y = np.kron(100.0 * (rng.random((6, 8)) > 0.5), np.ones((40, 40)))
    points = np.stack([rng.integers(0, n, 40) for n in Y.shape[::-1]], axis=-1)
    found = []
    for fov_deg in (30.0, 60.0, 90.0, 130.0):
        grid = AdaptationGrid.of(Y.shape, fov_deg, cells)
        nodes = grid.measure(grid.means(Y), 20.0)[0]
        down, across = (pixels_from_nodes(*each) for each in zip(grid.nodes, Y.shape, strict=True))
        own = (down @ nodes @ across.T)[points[:, 1], points[:, 0]]
        white = (95.05, 100.0, 108.88)
        true = [
            measured_conditions(Y, white, fov_deg, 1.0, (x, y), outside=20.0).Y_b
            for x, y in points.tolist()
        ]
        found.append(float(np.abs(own - true).max()))
    return found


CLAIMS += [
    Claim(f"fields/{cells}", "viewing.md", text, partial(field_errors, cells))
    for cells, text in {
        48: "within {} of Y_b at 30°, {} at 60°, {} at 90° and {} at 130°, on patches of black",
        32: "within {} of Y_b at 30°, {} at 60°, {} at 90° and {} at 130°, on the same patches",
    }.items()
]


@claim(
    "viewing.md",
    "the error is CIEDE2000 {} on average and {} at most, on hard patches from black to white at "
    "70°; before a black backdrop {} and {},",
)
def local_adaptation() -> Figures:
    image, found = patches(), []
    for backdrop in (0.2, 0.0):
        spec, off = RelightSpec(Viewing(adapting="pixel"), backdrop=backdrop), []
        for name in ("A", "D65", "FL2"):
            with warnings.catch_warnings(), Relighter(image, "numpy") as relighter:
                warnings.simplefilter("ignore")  # five channels hold no colours; both sides agree
                frame = relighter.frame(light(name), spec, dtype=np.float32)
            codes = frame.astype(np.float64), relight_reference(image, light(name), spec)
            off.append(shown_difference(*map(SPACES["sRGB"].decode, codes)))
        found += mean_and_most(np.array(off))
    return found


@claim(
    "viewing.md",
    "protan and deutan are CIEDE2000 {} and {} from Brettel's on random colours of sRGB, where the "
    "deficiency itself changes {} and {}",
)
def dichromats() -> Figures:
    RGB = test_deficiency.colours()
    own = {each: simulation(each, 1.0, SPACES["sRGB"]).apply(RGB) for each in ("protan", "deutan")}
    brettel = {each: RGB @ np.reshape(test_deficiency.BRETTEL[each], (3, 3)).T for each in own}
    others = (brettel[each] for each in own), (RGB for _ in own)
    return [
        float(shown_difference(one, other).mean())
        for each in others
        for one, other in zip(own.values(), each, strict=True)
    ]


@claim("viewing.md", "make a white of Z = {}, and of {} in its picture", slow=True)
def white_of_two_groups() -> Figures:
    scene = Scene.load(ROOT / "data/scenes/engine-groups.toml")
    image = scene.render()
    seen = replace(scene.relight.viewing, adopted_white="scene")
    lit = Illumination.of(
        image.basis, scene.lights[0].rig, replace(scene.relight, viewing=seen), image.groups
    )
    return [lit.white_XYZ[2], ViewingMeter().measure_viewing(image, lit)[0].adopted_white[2]]
