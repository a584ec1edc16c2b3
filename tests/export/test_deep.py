"""Deep files of layers: by OpenEXR's own reader, flattened here, and by OpenImageIO."""

import json
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from tests.export._layers import opened
from tests.raycast.test_layered import SIZE, SPEC, function
from tests.support.commands import call
from tests.support.errors import raises
from tests.support.raycasts import soft_ball
from volspec.camera import Camera
from volspec.errors import ImageError
from volspec.export.compositing import Recipe, save_for_compositors
from volspec.export.deep import DeepSamples, save_deep
from volspec.image import CoefficientImage
from volspec.pipeline import raycast
from volspec.spectra import light

STATES = ({}, {"copper": 0.3}, {"copper": 0}, {"gold": 4, "copper": 0.7})
ROUNDED = 1e-3
"""Eight layers of half floats, 2^-11 of each."""


@pytest.fixture(scope="module")
def image() -> CoefficientImage:
    ball = soft_ball(20)
    camera = Camera.orbit(ball, azimuth_deg=30, fov_deg=40)
    spec = replace(SPEC, layers=8, alpha_stop=0.98)
    return raycast(ball, function(), camera, SIZE, spec)


@pytest.fixture(scope="module")
def recipe(image: CoefficientImage) -> Recipe:
    return Recipe.of(image.basis, image.groups, {"day": light("D65"), "lamp": light("A")})


def over(channels: dict[str, NDArray[Any]], nearer_than: float = np.inf) -> dict[str, Any]:
    """Flatten what is nearer than a distance by over, in order of Z; samples are slabs."""
    flat = {name: np.zeros(channels["A"].shape) for name in channels if name[0] != "Z"}
    for at in np.ndindex(channels["A"].shape):
        through = 1.0
        if channels["Z"][at] is None:
            continue
        for sample in np.argsort(channels["Z"][at]):
            front, back, alpha = (float(channels[name][at][sample]) for name in ("Z", "ZBack", "A"))
            if front < nearer_than:
                part = min(1.0, (nearer_than - front) / max(back - front, 1e-9))
                own = 1 - (1 - alpha) ** part
                for name, pixels in flat.items():
                    pixels[at] += through * own / alpha * float(channels[name][at][sample])
                through *= 1 - own
    return flat


@pytest.mark.parametrize("opacities", STATES, ids=str)
def test_flattened_samples_are_the_recomposed_picture(image, recipe, tmp_path, opacities):
    """Flattened here, and by OpenImageIO if it is installed."""
    save_deep(image, tmp_path / "deep.exr", recipe, opacities)
    header, channels = opened(tmp_path / "deep.exr")
    assert header["type"] == OpenEXR.deepscanline
    assert list(json.loads(header["volspec:compositing"])["lights"]) == ["day", "lamp"]
    ways, picture = [over(channels)], image.recompose(opacities)
    if find_spec("OpenImageIO"):
        import OpenImageIO as oiio

        flat = oiio.ImageBufAlgo.flatten(oiio.ImageBuf(str(tmp_path / "deep.exr")))
        bands = np.moveaxis(flat.get_pixels(), -1, 0)
        ways.append(dict(zip(flat.spec().channelnames, bands, strict=True)))
    names = [f"{group}.c{k:02d}.V" for group in ("key", "sky_2") for k in range(3)]
    for pixels in ways:
        assert np.abs(pixels["A"] - picture.alpha).max() < ROUNDED
        found = np.dstack([pixels[name] for name in names])
        assert np.abs(found - picture.coefficients).max() < ROUNDED
        RGB = np.dstack([pixels[colour] for colour in "RGB"])
        assert np.abs(RGB - recipe.picture(picture, "day")).max() < ROUNDED


def test_a_card_in_the_middle_holds_out_what_is_behind_it(image, recipe, tmp_path):
    """OpenImageIO merges an opaque black card by depth, and cuts samples at it."""
    oiio = pytest.importorskip("OpenImageIO")
    save_deep(image, tmp_path / "deep.exr", recipe)
    channels = opened(tmp_path / "deep.exr")[1]
    at = float(np.median(np.concatenate([z for z in channels["Z"].flat if z is not None])))
    source = oiio.ImageBuf(str(tmp_path / "deep.exr"))
    spec = source.spec()
    card = oiio.ImageBuf(spec)
    for y, x in np.ndindex(spec.height, spec.width):
        card.set_deep_samples(x, y, 0, 1)
        for channel, name in enumerate(spec.channelnames):
            value = {"A": 1.0, "Z": at, "ZBack": at}.get(name, 0.0)
            card.set_deep_value(x, y, 0, channel, 0, value)
    both = oiio.ImageBufAlgo.flatten(oiio.ImageBufAlgo.deep_merge(source, card))
    red = both.get_pixels()[..., both.spec().channelnames.index("R")]
    wanted = over(channels, nearer_than=at)["R"]
    assert np.abs(red - wanted).max() < ROUNDED
    assert 0.2 * over(channels)["R"].sum() < wanted.sum() < 0.98 * over(channels)["R"].sum()


def test_samples_are_in_order_and_measured_from_the_camera_s_plane(image, recipe):
    samples = DeepSamples.of(image)
    pixel = np.arange(samples.counts.size).repeat(samples.counts.ravel())
    same = pixel[1:] == pixel[:-1]
    assert same.any() and (np.diff(samples.depth_mm)[same] > 0).all()
    assert (samples.back_mm >= samples.depth_mm).all()
    assert (samples.back_mm[:-1] <= samples.depth_mm[1:])[same].all()
    assert (samples.back_mm > samples.depth_mm)[pixel == pixel[np.flatnonzero(same)[0]]].all()
    parallel = DeepSamples.of(replace(image, fov_deg=None))
    height = SIZE[1]
    y, x = np.divmod(pixel, SIZE[0])
    half = np.tan(np.radians(20)) * 2 / height
    across = np.hypot((x - (SIZE[0] - 1) / 2) * half, (y - (height - 1) / 2) * half)
    wanted = parallel.depth_mm * np.cos(np.arctan(across))
    assert np.allclose(samples.depth_mm, wanted, rtol=2**-12)  # rounded to 13 binary digits


def test_the_command_writes_deep_and_faded_images(image, recipe, tmp_path):
    source = tmp_path / "i.exr"
    save_for_compositors(image, source, recipe)
    words = ("compositing", source, "--opacity", "copper=0.3")
    assert call(*words, "--deep", "--light", "A", "-o", tmp_path / "d.exr") == 0
    assert call(*words, "-o", tmp_path / "f.exr") == 0
    picture = image.recompose({"copper": 0.3})
    faded = CoefficientImage.load(tmp_path / "f.exr")
    assert np.abs(faded.coefficients - picture.coefficients).max() < 2e-3
    assert list(Recipe.load(tmp_path / "f.exr").lights) == ["day", "lamp"]
    assert faded.opacity_layers is None
    flat = over(opened(tmp_path / "d.exr")[1])
    lit = Recipe.of(image.basis, image.groups, {"A": light("A")}).picture(picture, "A")
    assert np.abs(np.dstack([flat[colour] for colour in "RGB"]) - lit).max() < 2e-3


def test_what_has_no_deep_samples_is_refused(image, recipe, tmp_path):
    flat = replace(image, opacity_layers=None)
    for code, made, name, opacities in (
        ("unsupported", flat, "d.exr", {}),
        ("unknown", image, "d.exr", {"silver": 1}),
        (None, image, "d.png", {}),
    ):
        with raises(ImageError, code):
            save_deep(made, tmp_path / name, recipe, opacities)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_picture_has_no_samples(image, recipe, tmp_path):
    save_deep(image, tmp_path / "d.exr", recipe, {"gold": 0, "copper": 0})
    alpha = opened(tmp_path / "d.exr")[1]["A"]
    assert not any(each is not None and len(each) for each in alpha.flat)
