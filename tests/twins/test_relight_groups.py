"""Light groups: the shader, its NumPy twin and the reference still make the same picture."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.relight_reference import relight_reference
from tests.support.relighting import COARSE, RAW, assert_close, box_basis, gl_or_skip, grouped_cast
from volspec.appearance.display.spaces import to_uint8
from volspec.basis import MODES, Basis, MaterialBasis
from volspec.errors import OpenGLError, ShapeError
from volspec.image.model import CoefficientImage
from volspec.relight import LightRig, Relighter, RelightSpec, relight
from volspec.relight import gpu as gpu_module
from volspec.relight.look import Look
from volspec.spectra import light, reflectance

pytestmark = COARSE
RIG = LightRig(
    tuple(map(light, ("A", "D65", "FL2", "HP1"))),
    (1.0, 0.4, 2.0, 0.3),
    (800.0, 300.0, 100.0, 500.0),
    ("key", "fill", "rim", ""),
)


def cast(count: int = 3, basis: Basis | None = None, **more: object) -> CoefficientImage:
    """Random surfaces in light groups key, fill, rim, group 3, …"""
    names = [*("key", "fill", "rim")[:count], *(f"group {g}" for g in range(3, count))]
    parts = np.random.default_rng(0).random(count)
    shares = dict(zip(names, (parts / parts.sum()).tolist(), strict=True))
    return grouped_cast(shares, basis or box_basis(7), **more)


@pytest.mark.parametrize("level", ["relative", "absolute"])
@pytest.mark.parametrize("mode", MODES)
def test_three_groups_match_the_reference_in_every_mode(backend, mode, level):
    image = cast()
    spec = RelightSpec(mode=mode, level=level)
    frame = relight(image, RIG, spec, dtype=np.float32, backend=backend)
    # llvmpipe's pow, measured 5e-5.
    truth = relight_reference(image, RIG, spec)
    assert_close(frame, truth, 2e-4, f"{mode}, {level}")
    codes = relight(image, RIG, spec, backend=backend)
    assert codes.dtype == np.uint8 and np.abs(codes.astype(int) - to_uint8(truth)).max() <= 1


@pytest.mark.parametrize(("count", "size"), [(8, 16), (8, 31)])
def test_as_many_groups_as_a_cast_can_have_are_drawn(count, size):
    image = cast(count, box_basis(size))
    gl_or_skip(image).close()
    frames = [relight(image, RIG, dtype=np.float32, backend=backend) for backend in ("gl", "numpy")]
    np.testing.assert_allclose(*frames, atol=2e-4)


def test_more_channels_than_a_device_or_a_picture_takes_are_refused_by_number(monkeypatch, context):
    most = context.info["GL_MAX_FRAGMENT_UNIFORM_COMPONENTS"]
    with gl_or_skip(cast()) as relighter:
        for other in (cast(7, box_basis(3)), cast(2)):
            with raises(ShapeError):
                relighter.update(other)
    # As if a layer needed a fifth of what this device has: 20 channels with alpha, not 22.
    monkeypatch.setattr(gpu_module, "_COMPONENTS_PER_LAYER", (most - 64) // 5)
    with raises(OpenGLError, "size") as caught:
        Relighter(cast(), backend="gl")
    assert {"21", "19"} <= set(re.findall(r"\b\d+\b", str(caught.value)))


def test_half_coefficients_give_the_frame_of_the_same_numbers_in_float32(backend):
    half = cast(half=True)
    whole = replace(half, coefficients=half.coefficients.astype(np.float32))
    assert half.coefficients.dtype == np.float16
    for spec in (RelightSpec(mode=mode) for mode in MODES):
        assert np.array_equal(*(relight(im, RIG, spec, backend=backend) for im in (half, whole)))


def test_a_relighter_follows_the_groups_of_a_new_image(backend):
    first, second = cast(seed=0), cast(seed=1)
    renamed = replace(second, groups=dict(zip("abc", second.groups.values(), strict=True)))
    rig = replace(RIG, groups=("a", "b", "c", ""))
    with Relighter(first, backend) as relighter:
        relighter.frame(RIG)
        relighter.update(renamed)
        updated = relighter.frame(rig)
    assert np.array_equal(updated, relight(second, RIG, backend=backend))


def test_reflectances_are_edited_in_every_group(backend):
    paints = {name: reflectance(name) for name in ("gold", "copper")}
    image, iron = cast(basis=MaterialBasis(paints)), {"gold": reflectance("iron")}
    with Relighter(image, backend) as relighter:
        before = relighter.frame(RIG, RAW)
        after = relighter.frame(RIG, Look(RelightSpec(RAW), iron))
        assert np.array_equal(before, relighter.frame(RIG, Look(RelightSpec(RAW))))
    assert not np.array_equal(before, after)
    assert np.array_equal(after, relight(image.with_reflectances(iron), RIG, RAW, backend=backend))
