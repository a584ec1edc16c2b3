"""Layers of opacity: other opacities without a cast, their file, and what they refuse."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from tests.support.errors import raises, refuses, warns
from tests.support.fixtures import slow
from tests.support.raycasts import (
    METAL_BASIS,
    METALS,
    WHOLE,
    along_z,
    cube,
    edit_exr,
    even_gold,
    metal_function,
    soft_ball,
)
from volspec.basis import MaterialBasis, SpectralBasis
from volspec.camera import Camera
from volspec.errors import ImageError, VolspecWarning
from volspec.image import CoefficientImage
from volspec.image.layers import OpacityLayers, shadow_of_means, transmittance
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import LightGroup, RaycastSpec
from volspec.raycast.launch.layer_stream import LayerStream, Samples
from volspec.raycast.launch.row_batches import Result
from volspec.raycast.lights import Ambient, Directional, Headlight, Point
from volspec.spectra import reflectance
from volspec.transfer import Isosurfaces, TransferFunction, TransferTable
from volspec.volume import Volume

GROUPS = (LightGroup("key", (Headlight(),)), LightGroup("sky 2", (Ambient(),)))
SIZE = 32, 24


def function() -> TransferFunction:
    """Copper below 0.5, gold above."""
    points = [(0.1, 0.0, "copper"), (0.2, 0.1, "copper"), (0.5, 0.1, "copper")]
    return metal_function(*points, (0.6, 0.2, "gold"), (1.0, 0.2, "gold"))


def scaled(table: TransferTable, scales: tuple[float, float]) -> TransferTable:
    """Return a table with each material's optical depth scaled, entry by entry."""
    assert table.left is None
    tau = -np.log1p(-table.opacity)[:, None] * table.material_weights * scales
    total = tau.sum(axis=1, keepdims=True)
    shares = np.where(total > 0, tau / np.maximum(total, 1e-300), table.material_weights)
    return replace(table, opacity=-np.expm1(-total[:, 0]), material_weights=shares)


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    return Raycaster(soft_ball(20))


def cast_ball(caster: Raycaster, spec: RaycastSpec) -> CoefficientImage:
    camera = Camera.orbit(caster.volume, azimuth_deg=30)
    return raycast(caster.volume, function(), camera, SIZE, spec, caster=caster)


def cast_scaled(caster: Raycaster, scales: tuple[float, float], spec: RaycastSpec) -> Result:
    """A new cast with other opacities."""
    camera = Camera.orbit(caster.volume, azimuth_deg=30)
    return caster.cast(scaled(caster.bake(function()), scales), camera, SIZE, spec)


SPEC = RaycastSpec(step_mm=0.25, specular=0.3, groups=GROUPS, alpha_stop=1.0)


@pytest.fixture(scope="module")
def image(caster: Raycaster) -> CoefficientImage:
    return cast_ball(caster, replace(SPEC, layers=8))


@pytest.mark.parametrize("scale", [0.0, 0.25, 2.0, 4.0])
def test_a_homogeneous_body_fades_by_beer_lambert(scale):
    volume, spec = cube(9), replace(WHOLE, layers=8)
    with warns("no opacity of copper"):
        made = raycast(volume, even_gold(0.1), along_z(volume), (4, 4), spec)
    shown = made.recompose({"gold": scale})
    assert shown.alpha[2, 2] == pytest.approx(1 - 0.9 ** (8 * scale), abs=2e-6)
    assert shown.coefficients[2, 2] == pytest.approx([0, shown.alpha[2, 2], 0], abs=2e-6)


@pytest.mark.parametrize("kind", ["image", slow("lit")])
def test_scale_1_is_the_picture_bit_for_bit(kind, request):
    image: CoefficientImage = request.getfixturevalue(kind)
    for scales in ({}, {"gold": 1}, {"gold": 1.0, "copper": 1}):
        same = image.recompose(scales)
        for name in ("coefficients", "alpha", "depth_mm"):
            assert np.array_equal(getattr(same, name), getattr(image, name))
    near = image.recompose({"gold": 1.0001})
    assert np.abs(near.coefficients - image.coefficients).max() < 1e-4


@pytest.mark.parametrize(
    "scales", [(1, 0.3), (0, 1), (1, 0), (4, 1), (0.25, 4), (4, 4)], ids=lambda s: f"{s}"
)
def test_other_opacities_are_those_of_a_new_cast(caster, image, scales):
    """Measured: an RMS of 0.001, 0.017 at most; alpha is exact."""
    shown = image.recompose(dict(zip(METALS, scales, strict=True)))
    assert shown.opacity_layers is None and shown.first_mm is None
    new = cast_scaled(caster, scales, SPEC)
    off = np.abs(shown.coefficients - new.coefficients)
    assert np.sqrt((off**2).mean()) < 0.002 and off.max() < 0.03
    assert np.abs(shown.alpha - new.alpha).max() < 1e-4
    seen = (new.alpha > 0.05) & (shown.alpha > 0.05)
    assert np.abs(shown.depth_mm[seen] - new.depth_mm[seen]).max() < 1.5


def test_a_slab_takes_its_shadow_with_it_exactly():
    """Light from +x passes 4 mm of copper to gold, which is seen along z: 0.9^(4 s) of it."""
    values = np.zeros((20, 20, 20), np.float32)
    values[:, :, :9], values[:, :, 13:17] = 1.0, 0.3
    volume, sun = Volume(values), LightGroup("sun", Directional((1.0, 0.0, 0.0), shadows=True))
    spec = RaycastSpec(ambient=0, layers=8, physical_light=True, groups=sun, alpha_stop=1.0)
    made = raycast(volume, function(), along_z(volume, 20), (20, 20), spec)

    def shade(copper: float, gold: float) -> float:
        """Return the light on gold 4 mm deep: that of the shade by the whole of the light, 0.7."""
        shown = made.recompose({"copper": copper, "gold": gold})
        return float(shown.coefficients[10, 4, 1] / shown.alpha[10, 4] / 0.7)

    assert shade(1, 1) == made.coefficients[10, 4, 1] / made.alpha[10, 4] / np.float32(0.7)
    own = -np.log(shade(0, 1))
    for copper, gold in ((0, 1), (0.25, 1), (1, 1), (4, 1), (4, 0.25), (2, 2), (0, 4)):
        light = np.exp(-gold * own) * 0.9 ** (4 * copper)
        assert shade(copper, gold) == pytest.approx(light, abs=3e-4), (copper, gold)


LIT = (
    LightGroup("key", (Directional((1.0, 0.7, 0.5), shadows=True), Headlight(0.3))),
    LightGroup("sky", (Ambient(occlusion=True), Point((30.0, 30.0, 40.0), shadows=True))),
)


@pytest.fixture(scope="module")
def lit(caster: Raycaster) -> CoefficientImage:
    return cast_ball(caster, replace(SPEC, groups=LIT, layers=8))


@pytest.mark.parametrize(
    ("scales", "least"),
    [slow(*own) for own in (((0, 1), 20), ((0.25, 1), 15), ((1, 0), 15), ((4, 1), 10))],
)
def test_shadows_are_those_of_a_new_cast(caster, lit, scales, least):
    """``least``: how many times closer they are than shadows that stay those of the cast."""
    given = dict(zip(METALS, scales, strict=True))
    new = cast_scaled(caster, scales, replace(SPEC, groups=LIT)).coefficients
    off = np.sqrt(((lit.recompose(given).coefficients - new) ** 2).mean())
    layers = lit.opacity_layers
    one = np.ones(2, np.float32)
    part = layers.shadow[..., :2] * (1 - transmittance(layers.shadow[..., 2:], one))[..., None]
    occluded = 2 * transmittance(layers.occlusion[..., 2:], one)
    part += layers.occlusion[..., :2] * (1 - np.minimum(occluded, 1))[..., None]
    shade, gloss = layers.shade * (1 - part[..., :1]), layers.gloss * (1 - part[..., 1])
    frozen = replace(layers, shade=shade, gloss=gloss, shadow=None, occlusion=None)
    stays = replace(lit, opacity_layers=frozen).recompose(given).coefficients
    assert off < 0.0015 and np.sqrt(((stays - new) ** 2).mean()) > least * off


@pytest.mark.parametrize("bend", [0.05, 0.5, 4.0])
def test_light_of_gamma_distributed_depths_is_exact(bend):
    """But for the fit of b, to 2 %."""
    depths = np.array([1.0, 0.5])

    def light(*scales: float) -> float:
        """Return the mean of e^(−g Σ s d) over a gamma distribution of g."""
        return float((1 + bend * (depths @ scales)) ** (-1 / bend))

    means = np.array([[1.0, 0.0, light(0.5, 0.5), light(1, 1), light(0.5, 0), light(0, 0.5)]])
    cast = shadow_of_means(means)[:, 2:]
    for scales in itertools.product((0.0, 0.25, 1.0, 4.0), repeat=2):
        found = transmittance(cast, np.array(scales, np.float32))
        assert found == pytest.approx(light(*scales), abs=4e-3), scales
    assert transmittance(cast, np.ones(2, np.float32)) == pytest.approx(light(1, 1), abs=1e-5)


def test_darkness_and_no_light_have_finite_numbers():
    dark = shadow_of_means(np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 1.0], [0, 0, 1, 1, 1, 1]]))
    assert np.isfinite(dark.astype(np.float16)).all()
    assert transmittance(dark[:, 2:], np.array([0, 4], np.float32)) == pytest.approx(1, abs=1e-5)


def test_one_ray_keeps_its_samples_while_there_is_room():
    stream, rng = LayerStream(1, 8, 1, 2), np.random.default_rng(1)
    alphas, weights = rng.uniform(0.3, 0.6, 6), rng.dirichlet((1, 1), 6)
    shade, gloss = np.array([[0.5]]), np.array([[0.1]])
    for k in range(6):
        at = np.array([float(k)])
        stream.add(np.array([0]), Samples(at, alphas[[k]], weights[[k]], shade, gloss))
    layers = OpacityLayers.of_rows(stream.rows()[None].astype(np.float32), [0, 1], 2, 1)
    tau = -np.log1p(-alphas)[:, None] * weights
    assert layers.tau[0, 0].sum(axis=0) == pytest.approx(tau.sum(axis=0), rel=1e-5)
    assert layers.shade[layers.tau[:, :, :, None] > 0] == pytest.approx(0.5, rel=1e-5)
    assert layers.gloss[np.isfinite(layers.depth_mm)] == pytest.approx(0.1, rel=1e-5)


def test_a_material_without_opacity_is_named_with_the_remedy(image):
    layers = image.opacity_layers
    tau = layers.tau.copy()
    tau[..., 1] = 0
    without = replace(image, opacity_layers=replace(layers, tau=tau))
    without.recompose({"gold": 0})
    with pytest.warns(VolspecWarning, match="'gold' has no opacity .* 0.02"):
        shown = without.recompose({"gold": 4})
    np.testing.assert_allclose(shown.alpha, without.alpha, atol=1e-6)


MANY = {f"m{k}": reflectance("gold") for k in range(5)}
OF_MANY = TransferFunction([(0.1, 0.1, "m0"), (1, 0.1, "m1")], MANY, MaterialBasis(MANY))
OF_SPECTRA = replace(function(), basis=SpectralBasis.load("general-7"))
SURFACE = Isosurfaces([(0.5, 0.5, "gold")], METALS, METAL_BASIS)
Make = Callable[[CoefficientImage], object]


def recomposed(scales: object) -> Make:
    return lambda image: image.recompose(scales)


def cast_in_layers(transfer: Any) -> Make:
    small = soft_ball(4)
    return lambda _: raycast(small, transfer, Camera.orbit(small), SIZE, RaycastSpec(layers=8))


def changed(name: str, of: Callable[[OpacityLayers], Any]) -> Make:
    """Return a call that makes layers with another array."""
    return lambda image: replace(image.opacity_layers, **{name: of(image.opacity_layers)})


def one_row_less(image: CoefficientImage) -> object:
    layers = OpacityLayers(*(each[:-1] for each in _arrays(image.opacity_layers)))
    return replace(image, opacity_layers=layers)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (recomposed({"silver": 2}), "unknown opacities"),
        (recomposed({"gold": -1}), "range opacity of 'gold'"),
        (recomposed({"gold": float("inf")}), "range opacity of 'gold'"),
        (recomposed({"gold": "much"}), "type opacity of 'gold'"),
        (lambda image: replace(image, opacity_layers=None).recompose({}), "unsupported "),
        (lambda _: RaycastSpec(layers=8, mode="maximum"), "conflict RaycastSpec.layers"),
        (lambda _: RaycastSpec(layers=8, preintegrated=True), "conflict RaycastSpec.layers"),
        (lambda _: RaycastSpec(layers=17), "range RaycastSpec.layers"),
        *(
            (cast_in_layers(each), "conflict raycast: layers")
            for each in (OF_SPECTRA, SURFACE, OF_MANY)
        ),
        (changed("gloss", lambda layers: layers.gloss[:, :, :4]), "shape opacity layers: gloss"),
        (changed("tau", lambda layers: layers.tau[..., 0]), "shape opacity layers: tau"),
        (changed("shade", lambda layers: layers.shade.astype(float)), "type opacity layers: shade"),
        (changed("shadow", lambda layers: layers.shade), "shape opacity layers: shadow"),
        (one_row_less, "shape coefficient image: opacity_layers"),
    ],
)
def test_what_has_no_layers_is_refused(image, make, fault):
    assert "8 layers of opacity" in repr(image)
    refuses(lambda: make(image), fault)


def _arrays(layers: OpacityLayers) -> tuple[np.ndarray, ...]:
    return layers.tau, layers.shade, layers.gloss, layers.depth_mm


def test_a_file_holds_the_layers_in_half_precision(image, tmp_path):
    image.save(tmp_path / "image.exr")
    again = CoefficientImage.load(tmp_path / "image.exr")
    loaded, own = again.opacity_layers, image.opacity_layers
    for stored in (own.as_stored(), loaded.as_stored()):
        assert all(map(np.array_equal, _arrays(loaded), _arrays(stored)))
    assert np.array_equal(loaded.tau > 0, own.tau > 2.0**-13)
    assert np.array_equal(loaded.depth_mm, own.depth_mm.astype(np.float16))
    assert np.array_equal(again.recompose({}).coefficients, image.coefficients)
    assert_recomposed_alike(again, image, 2e-3)


def assert_recomposed_alike(one: CoefficientImage, other: CoefficientImage, limit: float) -> None:
    for scales in ({"gold": 0.3}, {"copper": 0}, {"gold": 4, "copper": 4}):
        off = one.recompose(scales).coefficients - other.recompose(scales).coefficients
        assert np.abs(off).max() < limit


def test_stored_numbers_are_exact_to_what_shows(image):
    """Half of 2^-10 of white at any scale, or of 2^-5 of a shade; and rounding to half floats."""
    layers = image.opacity_layers
    stored = layers.as_stored()
    for scale in (0.25, 1.0, 4.0):
        one, other = (np.exp(-scale * each.tau.astype(float)) for each in (stored, layers))
        assert np.abs(one - other).max() <= 2.0**-11 + 1e-6
    total = layers.tau.sum(axis=-1)[..., None]
    for name, tau in (("shade", layers.tau[..., None, :]), ("gloss", total)):
        one, other = getattr(stored, name).astype(float), getattr(layers, name)
        step = np.minimum(2.0**-10 / np.maximum(1 - np.exp(-4.0 * tau), 1e-9), 2.0**-5)
        assert (np.abs(one - other) <= 0.5 * step + 2.0**-11 * np.abs(other) + 1e-7).all()


def saved_names(image: CoefficientImage, path: Path) -> tuple[set[str], object]:
    """Save an image; return its channels' names and what the header says of the layers."""
    image.save(path)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return set(file.channels()), json.loads(file.header()["volspec:layers"])


def test_a_file_holds_shadows_with_its_second_version(lit, tmp_path):
    names, about = saved_names(lit, tmp_path / "image.exr")
    written = {"l3.shadow.part.sky.V", "l3.shadow.depth.key.gold.V", "l0.occlusion.bend.sky.V"}
    assert written <= names and "l3.occlusion.part.key.V" not in names
    assert about == {"version": 2, "count": 8, "shadow": ["key", "sky"], "occlusion": ["sky"]}
    assert_recomposed_alike(CoefficientImage.load(tmp_path / "image.exr"), lit, 3e-3)


OF_NO_GROUP = '{"version": 2, "count": 8, "shadow": ["moon"], "occlusion": []}'


def about(text: str) -> Callable[[Any, Any], object]:
    return lambda header, _: header.update({"volspec:layers": text})


@pytest.mark.parametrize(
    ("kind", "change", "code"),
    [
        ("image", about('{"version": 4, "count": 8}'), "unsupported"),
        ("image", about('{"count": 8}'), "damaged"),
        ("image", about("5"), "damaged"),
        ("image", about('{"version": 1, "count": "x"}'), "damaged"),
        ("image", about('{"version": 1, "count": 99}'), "damaged"),
        ("image", lambda h, c: c.pop("l3.tau.gold.V"), "damaged"),
        ("image", lambda h, c: c["l0.gloss.key.V"].fill(np.nan), "damaged"),
        ("lit", about('{"version": 2, "count": 8}'), "damaged"),
        ("lit", about(OF_NO_GROUP), "damaged"),
        ("lit", lambda h, c: c.pop("l3.shadow.depth.key.gold.V"), "damaged"),
        ("lit", lambda h, c: c["l0.shadow.bend.key.V"].fill(np.nan), "damaged"),
    ],
)
def test_a_damaged_or_later_file_is_refused(kind, change, code, request, tmp_path):
    request.getfixturevalue(kind).save(tmp_path / "image.exr")
    edit_exr(tmp_path / "image.exr", change)
    with raises(ImageError, code):
        CoefficientImage.load(tmp_path / "image.exr")


def test_names_in_the_file_are_plain(image, tmp_path):
    names, about = saved_names(image, tmp_path / "image.exr")
    assert {"l0.tau.copper.V", "l7.shade.sky_2.gold.V", "l7.gloss.key.V", "l7.depth.Z"} <= names
    assert about == {"version": 1, "count": 8}
