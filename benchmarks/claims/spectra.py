"""Figures of bases, reflectances, spectra in files, palettes and rooms."""

from __future__ import annotations

import io
import json
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from benchmarks import basis as bases
from benchmarks import recovery, rooms
from benchmarks.claims.model import (
    CLAIMS,
    ROOT,
    Array,
    Claim,
    Figures,
    claim,
    difference,
    mean_and_most,
    shown_difference,
)
from tools import recovery_figures
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.models.lab import cielab
from volspec.basis import SpectralBasis
from volspec.basis.report import BasisReport
from volspec.cli import main
from volspec.export.page.packing import residual_bytes
from volspec.export.spectral import SpectralIllumination
from volspec.palette import DesignReport, design, load_palette
from volspec.relight import Illumination, Relighter, RelightSpec
from volspec.scene import Scene
from volspec.spectra import (
    XYZ_from_spectra,
    light,
    light_set,
    reflectance_set,
    reflectances_from_colours,
    white_XYZ,
)
from volspec.spectra.construct.base import ROUTES, base_spectra
from volspec.spectra.construct.colours import XYZ_from_sRGB
from volspec.spectra.construct.search import Tetrahedra, clip_to_hull, select_distinct
from volspec.spectra.datasets import colour_matching_functions, colour_science

# Bases.


@cache
def general(size: int) -> list[BasisReport]:
    """Return the reports of a general basis under smooth and spiky lights."""
    return bases.reports(f"general-{size}")


@claim(
    "README.md",
    "a mean CIEDE2000 of {} on held-out reflectances under smooth lights, {} under spiky ones "
    "such as sodium; an RGB renderer's product is off by {} and {})",
)
def general_7() -> Figures:
    found = general(7)
    return [r.fitted.mean for r in found] + [r.rgb_product.mean for r in found]


@claim("bases.md", "for six materials in seven channels, to CIEDE2000 {} under the library's 115")
def own_materials() -> Figures:
    S = reflectance_set("test")[::15]
    basis = replace(SpectralBasis.load("general-7"), samples=S)
    mixed = np.vstack([S, np.random.default_rng(0).dirichlet(np.ones(len(S)), 50) @ S])
    off = [
        difference(basis.xyz(basis.analyse(mixed), E), XYZ_from_spectra(E, mixed), white_XYZ(E))
        for E in (*light_set("smooth"), *light_set("spiky"))
    ]
    return [float(np.max(off))]


@claim(
    "bases.md",
    "Channels of 8 bits raise the mean of a positive basis under smooth lights to {} "
    "(`general-7-positive`) and {} (`general-9-positive`;",
)
def eight_bit_channels() -> Figures:
    S, found = reflectance_set("test"), []
    for name in ("general-7-positive", "general-9-positive"):
        basis = SpectralBasis.load(name)
        channels = np.rint(basis.analyse(S) * 255.0) / 255.0
        off = [
            difference(basis.xyz(channels, E), XYZ_from_spectra(E, S), white_XYZ(E))
            for E in light_set("smooth")
        ]
        found.append(float(np.mean(off)))
    return found


# A reflectance for a colour.

_TESTS = cache(lambda: {each.name: each for each in recovery.tests()})
_NAMES = {
    "delaunay": "`delaunay`",
    "tetrahedron": "`tetrahedron`",
    "smoothest": "`smoothest`",
    "otsu-2018": "Otsu 2018",
    "jakob-2019": "Jakob 2019",
    "meng-2015": "Meng 2015",
    "mallett-2019": "Mallett 2019",
    "smits-1999": "Smits 1999",
}


def recovered(test: str, method: str, lamps: Sequence[str]) -> Iterator[float]:
    """Yield mean, 95 % and maximum of a method's CIEDE2000 under each lamp."""
    given = _TESTS()[test]
    XYZ = XYZ_from_spectra(light("D65"), given.true)
    made = reflectances_from_colours(XYZ, method, "D65", base=given.base).values
    for lamp in lamps:
        off = recovery.errors(made, given.true, lamp)
        yield from (float(off.mean()), float(np.percentile(off, 95)), float(off.max()))


def _recovery_claims() -> Iterator[Claim]:
    three, page = "{} / {} / {}", "reflectance.md"
    for method, label in _NAMES.items():
        note = " (3 of 24 by `delaunay`)" if method == "tetrahedron" else ""

        def checker(method: str = method) -> Figures:
            mean, _, _, *others = recovered("ColorChecker", method, ("D65", "A", "FL11"))
            return [mean, *others]

        def others(method: str = method) -> Figures:
            return [x for test in ("natural", "patches") for x in recovered(test, method, ("A",))]

        text = f"| {label}{note} | {{}} | {three} | {three} |"
        yield Claim(f"checker/{method}", page, text, checker, slow=method == "meng-2015")
        if method != "meng-2015":
            text = f"| {label} | {three} | {three} |"
            yield Claim(f"others/{method}", page, text, others, slow=method == "jakob-2019")


CLAIMS += _recovery_claims()


@claim(
    "reflectance.md",
    "Without the {} of {} that are within an RMS of .02 of a patch, measured or as a power, "
    "`delaunay` has {} / {} / {} under A",
)
def without_near_copies() -> Figures:
    given = _TESTS()[recovery.NO_COPIES].base
    names = [{name for name in each.names if "/" in name and "^" not in name}
             for each in (base_spectra(), given)]  # fmt: skip
    all_of_them, apart = map(len, names)
    return [all_of_them - apart, all_of_them, *recovered(recovery.NO_COPIES, "delaunay", ("A",))]


def _coverage(stage: int) -> Figures:
    base = recovery_figures.STAGES()[stage][1]
    shares = recovery_figures.xy_share(base), recovery_figures.solid_share(base)
    return [len(base), *(100.0 * share for share in shares)]


CLAIMS += [
    Claim(f"coverage/{stage}", "reflectance.md", f"| {label} | {{}} | {{}} % | {{}} % |",
          partial(_coverage, stage))
    for stage, label in enumerate((
        "measured, and 122 flats", "with Bouguer's law", "with 10^(−R l), l = 1, 2, 4, in addition",
    ))
]  # fmt: skip


@claim("reflectance.md", "none of the five contains it ({} of the Academy's {} patches)")
def patches_without_tetrahedron() -> Figures:
    given = _TESTS()["patches"]
    XYZ = XYZ_from_spectra(light("D65"), given.true)
    counts = reflectances_from_colours(XYZ, "tetrahedron", base=given.base).counts()
    return [counts["delaunay"], len(XYZ)]


@claim("reflectance.md", "within {} of XYZ (Y = 100 for white)", slow=True, rounding=True)
def colours_of_sRGB() -> Figures:
    return [sRGB_cube()[1]]


@claim("reflectance.md", "{} % of them mixed", slow=True)
def mixed_of_sRGB() -> Figures:
    return [sRGB_cube()[0]]


@cache
def sRGB_cube() -> tuple[float, float]:
    """Return the mixed colours of sRGB in percent, and the largest error of XYZ."""
    levels, E = np.linspace(0.0, 1.0, recovery.CUBE), light("D65")
    XYZ = XYZ_from_sRGB(np.stack(np.meshgrid(levels, levels, levels), axis=-1), white_XYZ(E))
    made = reflectances_from_colours(XYZ)
    mixed = 100.0 * made.counts()["delaunay"] / made.route.size
    assert made.values.min() >= 0.0 and made.values.max() <= 1.0
    return mixed, float(np.abs(XYZ_from_spectra(E, made.values) - XYZ).max())


@claim(
    "reflectance.md",
    "becomes a step of {} under A on average; with `smoothest` outside it would become {},",
)
def step_across_the_hull() -> Figures:
    E = light("D65")
    white = white_XYZ(E)
    given = XYZ_from_sRGB(np.random.default_rng(1).uniform(0, 1, (500, 3)), white)
    beyond = given[reflectances_from_colours(given).route == ROUTES.index("extended")]
    points = XYZ_from_spectra(E, base_spectra().values) / white
    mesh = Tetrahedra.of(points[select_distinct(points)])
    edge = clip_to_hull(mesh, beyond / white) * white
    inside = reflectances_from_colours(edge).values
    just = edge + 1e-4 * (beyond - edge)
    return [
        float(recovery.errors(inside, reflectances_from_colours(just, each).values, "A").mean())
        for each in ("delaunay", "smoothest")
    ]


def ramp_steps(method: str) -> Figures:
    """Return the largest step under A by its own under D65: median and maximum of 40 ramps."""
    rng, E, A = np.random.default_rng(0), light("D65"), light("A")
    found = []
    for _ in range(40):
        ends = rng.uniform(0.0, 1.0, (2, 3))
        XYZ = XYZ_from_sRGB(np.linspace(*ends, 100), white_XYZ(E))
        seen = XYZ_from_spectra(A, reflectances_from_colours(XYZ, method).values)
        own = difference(XYZ[1:], XYZ[:-1], white_XYZ(E))
        found.append((difference(seen[1:], seen[:-1], white_XYZ(A)) / own).max())
    return [float(np.median(found)), float(np.max(found))]


CLAIMS += [
    Claim(f"ramps/{method}", "reflectance.md", text, partial(ramp_steps, method), slow=True)
    for method, text in {
        "delaunay": "step under A is {} times its own in the median of 40, and {} at most",
        "smoothest": "with `smoothest` {} and {}.",
        "tetrahedron": "`tetrahedron` jumps from one set of corners to another: {} and {}.",
    }.items()
]


@claim("reflectance.md", "Greys from `#282828` on have under A a chroma C\\*ab of {} at most")
def greys_under_A() -> Figures:
    E, A = light("D65"), light("A")
    XYZ = XYZ_from_sRGB(np.repeat(np.arange(40, 256)[:, None] / 255.0, 3, axis=1), white_XYZ(E))
    Lab = cielab(XYZ_from_spectra(A, reflectances_from_colours(XYZ).values), white_XYZ(A))
    return [float(np.hypot(*Lab[:, 1:].T).max())]


# Spectra in files.


def spectral_errors(name: str, mode: str, sampled: bool = False) -> dict[str, tuple[float, float]]:
    """Return CIEDE2000 of spectra from frames of a mode, mean and maximum by light."""
    basis, S = SpectralBasis.load(name), reflectance_set("test")
    channels, one = basis.analyse(S), np.ones(len(S))
    Q = colour_matching_functions(basis.grid)
    if sampled:
        shape = colour_science().SpectralShape(380, 780, 5)
        observer = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
        Q = observer.copy().align(shape).values.T
    found = {}
    for lamp in ("A", "FL2", "D65"):
        E, spec = light(lamp), RelightSpec(mode=mode, backdrop=0.0)
        bands = SpectralIllumination.of(basis, E, spec).pixels(channels, one)[:, 3:]
        own = Illumination.of(basis, E, spec).scene_XYZ(channels, one)
        XYZ = 100.0 * bands @ Q.T / Q[1].sum()
        found[lamp] = mean_and_most(difference(XYZ, own, white_XYZ(E)))
    return found


def _most(name: str, *modes: str, sampled: bool = False) -> Figures:
    """Return mean and maximum under the worst light, in each mode."""
    found = (list(spectral_errors(name, mode, sampled).values()) for mode in modes)
    return [x for errors in found for x in np.max(errors, axis=0).tolist()]


CLAIMS += [
    Claim(
        f"spectral/{name}", "compositing.md", text, partial(_most, name, "fitted", "componentwise")
    )
    for name, text in {
        "general-7": "| `general-7` | {}, FL2 | {}, FL2 | {} | {}, A |",
        "general-7-positive": "| `general-7-positive` | {}, FL2 | {}, FL2 | {}, FL2 | {}, FL2 |",
        "exact-7": "| `exact-7` | {}, A | {}, FL2 | {}, FL2 | {}, FL2 |",
    }.items()
]


@claim("compositing.md", "frame's is {} on average and {} at most over the test reflectances")
def spectral_by_sampled_observer() -> Figures:
    return _most("general-7", "exact", sampled=True)


@cache
def engine_codes() -> dict[str, tuple[float, float, float]]:
    """Return CIEDE2000, mean and maximum under the worst light, and kB of a page's codes."""
    scene = Scene.load(ROOT / "data/scenes/engine.toml")
    image = scene.render(size=(512, 512))
    planes = np.concatenate([image.coefficients, image.alpha[..., None]], axis=-1)
    space, covered = SPACES["sRGB"], image.alpha > 0.0

    def frames(values: Array) -> list[Array]:
        channels, alpha = np.split(values.astype(np.float32), [-1], axis=-1)
        with Relighter(replace(image, coefficients=channels, alpha=alpha[..., 0]), "numpy") as own:
            shown = [own.frame(each.rig, scene.relight, dtype=np.float32) for each in scene.lights]
        return [space.decode(each.astype(np.float64))[covered] for each in shown]

    true, found = frames(planes), {}
    for name, bits, root in (("value", 8, 1), ("8", 8, 2), ("10", 10, 2), ("12", 12, 2)):
        roots = np.copysign(np.abs(planes) ** (1.0 / root), planes)
        low, high = roots.min(axis=(0, 1)), roots.max(axis=(0, 1))
        steps = (high - low) / (2**bits - 1)
        codes = np.rint((roots - low) / steps).astype(np.int32)
        back = low + codes * steps
        off = [
            shown_difference(*each)
            for each in zip(frames(np.copysign(np.abs(back) ** root, back)), true, strict=True)
        ]
        packer = zlib.compressobj(9, zlib.DEFLATED, 15, 9, zlib.Z_RLE)
        size = len(packer.compress(residual_bytes(codes, bits)) + packer.flush())
        found[name] = (*mean_and_most(max(off, key=np.mean)), size / 1000.0)
    return found


CLAIMS += [
    Claim(
        f"codes/{name}",
        "page.md",
        f"{label} | {{}} | {{}} | {{}} kB |",
        lambda name=name: engine_codes()[name],
        slow=True,
    )
    for name, label in {
        "value": "8 bits, equal steps of the value",
        "8": "**8 bits, equal steps of the root**",
        "10": "10 bits, of the root",
        "12": "**12 bits, of the root**",
    }.items()
]


# Palettes and rooms.


@cache
def designed(name: str, step_nm: int = 10) -> DesignReport:
    """Return the report of a palette that ships, on bands of a width."""
    text = (ROOT / f"data/palettes/{name}.toml").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "palette.toml")
        path.write_text(
            text.replace("grid_nm = [400, 700, 10]", f"grid_nm = [400, 700, {step_nm}]")
        )
        return DesignReport.of(design(load_palette(path)))


@claim("models.md", "CIEDE2000 finds {}, {} and a mean of {} there.")
def sodium_of_figure_1() -> Figures:
    made = designed("figure-1")
    return [*(made.cell((name, "sodium")).error for name in ("flame", "paint")), made.mean]


def merged(step_nm: int) -> dict[str, tuple[float, float]]:
    """Return ΔE00 of figure 2's pairs under split 1: on the palette's bands, and at 1 nm."""
    pairs = [each for each in designed("figure-2", step_nm).metamers if each.light == "split 1"]
    return {each.reflectances[1].split()[1]: (each.delta_E, each.delta_E_1nm) for each in pairs}


@claim("palettes.md", "are ΔE00 {} apart on 31 bands and {} at 1 nm")
def two_reds() -> Figures:
    return merged(10)["red"]


@claim("palettes.md", "which leaves {} ({} for the blues;", slow=True)
def two_reds_on_narrow_bands() -> Figures:
    return [merged(3)[name][1] for name in ("red", "blue")]


@claim("palettes.md", "to {} % for the flame and the paint of")
def observers_of_figure_1() -> Figures:
    return [100.0 * each.observers.alike for each in designed("figure-1").metamers]


@claim("palettes.md", "and to {} to {} % for the pairs of `figure-2.toml` under D65")
def observers_of_figure_2() -> Figures:
    alike = [100.0 * e.observers.alike for e in designed("figure-2").metamers if e.light == "D65"]
    return [min(alike), max(alike)]


def section_5(paint: str) -> Figures:
    """Return x, y, J, C, h of a paint as chosen, and in both lights' rooms."""
    rows = [line[26:].split()[:5] for line in _section_5()]
    start = 3 * list(rooms.PAINTS).index(paint)
    return [float(cell) for row in rows[start : start + 3] for cell in row]


_section_5 = cache(lambda: list(rooms.section_5())[1:])
CLAIMS += [
    Claim(
        f"section 5/{paint}",
        "rooms.md",
        f"| {paint}, `{code}` | chosen | {{}}, {{}} | {{}} | {{}} | {{}} | "
        + " ".join(f"| | {lamp} | {{}}, {{}} | {{}} | {{}} | {{}} |" for lamp in rooms.LIGHTS),
        partial(section_5, paint),
        slow=True,
    )
    for paint, code in rooms.PAINTS.items()
]


@claim("rooms.md", "at {} lx on its back wall, go from {} to {} (`volspec room`)", slow=True)
def beige_walls() -> Figures:
    printed = io.StringIO()
    with redirect_stdout(printed), suppress(SystemExit):
        main(["room", str(ROOT / "data/rooms/beige-tungsten.toml"), "--json"])
    rows = json.loads(printed.getvalue())
    back = next(
        row
        for row in (rows if isinstance(rows, list) else rows["surfaces"])
        if row["surface"] == "back"
    )
    return [back["lux"], back["chosen C"], back["C"]]
