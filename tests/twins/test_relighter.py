"""Promises of a Relighter, on a coefficient image of a small hand-made basis."""

import gc
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import moderngl
import numpy as np
import pytest

from tests.support.errors import raises, refuses, warns
from tests.support.patience import in_fork
from tests.support.relighting import COARSE, GRID, RAW, box_basis, cast, gl_or_skip
from volspec._gpu import opengl
from volspec._gpu.opengl import headless_context
from volspec.appearance import Viewing, lut3d
from volspec.appearance.display.spaces import decode_sRGB
from volspec.appearance.lut3d import MAX_LUTS, Lut3D, LutCache, LutKey
from volspec.errors import LutCancelled, OpenGLError, ShapeError, ViewingError
from volspec.image.model import CoefficientImage
from volspec.relight import Illumination, LightRig, Relighter, RelightSpec, relight
from volspec.relight import gpu as gpu_module
from volspec.relight import programs as programs_module
from volspec.relight.texture_planes import TexturePlanes
from volspec.spectra import Spectrum, light

pytestmark = COARSE
A, D65 = light("A"), light("D65")


def test_pixels_of_the_image_are_those_of_the_frame(backend):
    # D65 sampled in 31 bands misses the display's white by less than a code.
    frame = relight(cast(), D65, RelightSpec(backdrop=0.0), backend=backend)
    assert frame[0].min() >= 254 and frame[-1].max() == 0
    coefficients, alpha = np.zeros((3, 4, 5), np.float32), np.ones((3, 4), np.float32)
    coefficients[1, 0] = 1.0
    image = CoefficientImage(coefficients, alpha, alpha, box_basis())
    frame = relight(image, D65, backend=backend)
    assert frame[1, 0].min() > 250 and np.count_nonzero(frame.any(axis=-1)) == 1
    # The display's own eye is adapted to D65 by D = 0.83 only, so a trace of tint may stay.
    frame = relight(cast(), A, Viewing(D=1.0), backend=backend, dtype=np.float32)
    assert frame[0].min() > 0.99


def test_backdrop_is_a_lit_diffuser(backend):
    with Relighter(cast(), backend) as relighter:
        grey, same = (
            relighter.frame(A, RelightSpec(RAW, backdrop=behind), dtype=np.float32)
            for behind in (0.2, Spectrum([390, 710], [0.2, 0.2]))
        )
    np.testing.assert_allclose(grey, same, atol=1e-6)
    # Tungsten unadapted: red above green above blue; Y is the reflectance.
    linear = decode_sRGB(grey[-1, 0])
    assert linear[0] > linear[1] > linear[2]
    np.testing.assert_allclose(linear @ [0.2126, 0.7152, 0.0722], 0.2, atol=2e-3)


def test_lights_of_a_rig_add_up(backend):
    dim = Viewing(model="none", illuminance_lux=2000.0)
    spec = RelightSpec(dim, level="absolute", mode="exact")
    with Relighter(cast(), backend) as relighter:

        def linear(*weights: float) -> np.ndarray:
            rig = LightRig((A, D65), weights, illuminance_lux=(200.0, 300.0))
            return decode_sRGB(relighter.frame(rig, spec, dtype=np.float32))

        alone, both, half = linear(1, 0) + linear(0, 1), linear(1, 1), linear(0.5, 0.5)
    assert both.max() < 1.0, "clipping would hide the sum"
    # float32 codes, steep near black.
    np.testing.assert_allclose(both, alone, atol=2e-5)
    np.testing.assert_allclose(half, both / 2.0, atol=2e-5)


def test_relative_level_ignores_a_light_s_power(backend):
    with Relighter(cast(), backend) as relighter:
        once, thrice = (relighter.frame(lamp, dtype=np.float32) for lamp in (A, A * 3.0))
    np.testing.assert_allclose(once, thrice, atol=1e-6)


def test_weights_may_be_an_array():
    given = LightRig((A, D65), weights=np.array([0.25, 2.0]), illuminance_lux=np.array([5, 7]))
    assert (given.weights, given.total_lux) == ((0.25, 2.0), 0.25 * 5 + 2 * 7)
    assert LightRig((A, D65), weights=np.array([])).weights == (1.0, 1.0)


def test_light_change_uploads_nothing(monkeypatch):
    with gl_or_skip(cast()) as relighter:
        assert relighter.backend not in ("", "numpy"), "the device's name"
        first = relighter.frame(A)
        monkeypatch.setattr(gpu_module.GLEngine, "upload", None)
        monkeypatch.setattr(gpu_module, "pack_layers", None)
        monkeypatch.setattr(programs_module, "compile_program", None)
        assert not np.array_equal(first, relighter.frame(D65))
        assert np.array_equal(first, relighter.frame(A))


def test_an_image_packed_beforehand_is_the_image(backend, monkeypatch):
    first, second = cast(seed=0), cast(seed=1)
    one, other = TexturePlanes.of(first), TexturePlanes.of(second)
    monkeypatch.setattr(gpu_module, "pack_layers", None)  # nobody packs any more
    with Relighter(first, backend, packed=one) as relighter:
        frames = [relighter.frame(A)]
        relighter.update(second, other)
        frames.append(relighter.frame(A))
    monkeypatch.undo()
    for image, frame in zip((first, second), frames, strict=True):
        assert np.array_equal(frame, relight(image, A, backend=backend))


def test_only_the_last_channels_are_packed_and_uploaded_again(backend):
    first, second = cast(seed=0), cast(seed=1)
    channels = first.coefficients.shape[2]
    mixed = first.coefficients.copy()
    mixed[..., -2:] = second.coefficients[..., -2:]
    packed = TexturePlanes.last(first, 2)
    assert packed.first == (channels - 2) // 4
    packed.put(channels - 2, second.coefficients[..., -2:])
    image = replace(first, coefficients=mixed)
    with Relighter(first, backend) as relighter:
        relighter.frame(A)
        relighter.update(image, packed)
        frame = relighter.frame(A)
    assert np.array_equal(frame, relight(image, A, backend=backend))


def test_several_relighters_work_at_once_and_in_any_thread():
    one, two = gl_or_skip(cast(seed=0)), gl_or_skip(cast(seed=1))
    first, second = one.frame(A), two.frame(A)
    frames: list[np.ndarray] = []
    thread = threading.Thread(target=lambda: frames.append(one.frame(A)))
    thread.start()
    thread.join()
    two.close()
    assert not np.array_equal(first, second)
    assert np.array_equal(frames[0], first)
    assert np.array_equal(one.frame(A), first)
    one.close()


def test_threads_share_a_relighter():
    lights = A, D65
    with gl_or_skip(cast()) as relighter, ThreadPoolExecutor(4) as threads:
        wanted = [relighter.frame(each) for each in lights]
        frames = list(threads.map(lambda n: relighter.frame(lights[n % 2]), range(200)))
    assert all(np.array_equal(frame, wanted[n % 2]) for n, frame in enumerate(frames))


@pytest.mark.parametrize("lent", [False, True])
def test_what_a_collected_relighter_made_is_released_when_the_next_is_made(context, lent):
    given = {"context": context if lent else None}
    texture = gl_or_skip(cast(), **given)._engine._texture
    gc.collect()
    gl_or_skip(cast(), **given).close()
    assert isinstance(texture.mglo, moderngl.InvalidObject)


def test_a_fork_relights_with_numpy_and_not_with_a_relighter_of_before():
    with gl_or_skip(cast()) as relighter:
        error = in_fork(lambda: relighter.frame(A))
        assert (type(error), error.code) == (OpenGLError, "state") and "'spawn'" in error.remedy
        assert in_fork(relighter.close) is None

    def fallback() -> str:
        with warns("'spawn'"):
            return Relighter(cast()).backend

    assert in_fork(fallback) == "numpy"


def test_a_context_is_lent_to_one_relighter_at_a_time():
    gl_or_skip(cast()).close()
    first, second = gl_or_skip(cast()), gl_or_skip(cast(seed=1))
    assert first._engine._context is not second._engine._context
    context = first._engine._context
    first._engine.close()
    first.close()
    third, fourth = gl_or_skip(cast()), gl_or_skip(cast())
    assert third._engine._context is context and fourth._engine._context is not context
    for each in (second, third, fourth):
        each.close()
    assert len(opengl._idle_contexts()) <= opengl._MAX_IDLE


@pytest.mark.parametrize("adapting", ["given", "picture"])
def test_a_table_made_beforehand_on_another_thread_is_what_the_frame_is_drawn_with(
    monkeypatch, adapting
):
    rig = LightRig((A,), illuminance_lux=(500.0,))
    viewing = Viewing(model="Nayatani95", adapting=adapting, fov_deg=20.0)
    how = rig, RelightSpec(viewing, "exact")
    with gl_or_skip(cast()) as alone:
        alone_key, expected = alone.missing_lut(*how), alone.frame(*how)
        assert alone.missing_lut(*how) is None
        assert alone.missing_lut(A, RAW) is None
    tables = LutCache()
    first, second = (gl_or_skip(cast(), lut_cache=tables) for _ in range(2))
    with first, second:
        key = first.missing_lut(*how)
        assert key is not None and key == alone_key and key not in tables
        thread = threading.Thread(target=tables.texels, args=(key,))
        thread.start()
        thread.join()
        monkeypatch.setattr(Lut3D, "of", None)  # nobody works one out any more
        assert first.missing_lut(*how) is None and second.missing_lut(*how) is None
        for relighter in (first, second):
            assert np.array_equal(relighter.frame(*how), expected)
    with Relighter(cast(), backend="numpy") as host:
        assert host.missing_lut(*how) is None


def test_a_table_that_is_given_up_is_not_kept():
    tables, asked = LutCache(), []
    key = LutKey(Viewing(model="Nayatani95"), (95.05, 100.0, 108.88))
    with suppress(LutCancelled):
        tables.texels(key, lambda: (asked.append(True), len(asked) == 3)[1])
    assert len(asked) == 3 and key not in tables


def test_of_tables_the_latest_are_kept(monkeypatch):
    made: list[LutKey] = []
    empty = np.zeros((1, 1, 1, 4), np.float32)
    monkeypatch.setattr(lut3d, "_bake_texels", lambda key, _: (made.append(key), empty)[1])
    tables, keys = LutCache(), [LutKey(RAW, (95.0, 100.0, 80.0 + i)) for i in range(20)]
    for key in keys:
        tables.texels(key)
        tables.texels(keys[0])  # asked for again and again
    assert made == keys
    assert [key in tables for key in keys] == [True, *[False] * 8, *[True] * (MAX_LUTS - 1)]


def test_given_context_is_drawn_in_and_left_alive():
    gl_or_skip(cast()).close()
    context = headless_context()
    with Relighter(cast(), context=context) as relighter, context:
        context.enable(context.BLEND | context.DEPTH_TEST | context.CULL_FACE)
        frame = relighter.frame(A)
    with context:
        assert context.buffer(reserve=16).size == 16
    assert np.array_equal(frame, relight(cast(), A, backend="gl"))
    context.release()


@pytest.mark.parametrize("table", [False, True])
def test_pixels_outside_of_a_box_stay_as_they_were(context, table):
    with Relighter(cast(), context=context, lut3d=table) as relighter:
        wanted, whole = relighter.frame(D65), relighter.frame(A)
        wanted[1:4, 2:4] = whole[1:4, 2:4]
        relighter.draw(D65)
        target = relighter.draw(A, within=(2, 1, 2, 3))
        with context:
            drawn = np.frombuffer(target.read(components=3, alignment=1), np.uint8)
        # A box may be drawn by a table where the whole is not, as a colour elsewhere is not in it.
        np.testing.assert_allclose(drawn.reshape(wanted.shape), wanted, rtol=0, atol=int(table))
        # What is drawn next is whole again.
        np.testing.assert_array_equal(relighter.frame(A), whole)


def test_without_a_gl_context_numpy_draws_and_one_warning_says_why(monkeypatch):
    missing = Mock(side_effect=OpenGLError("OpenGL: no headless context (test)"))
    monkeypatch.setattr(gpu_module, "lend_context", missing)
    with warns("no headless context (test)"):
        relighter = Relighter(cast())
    assert relighter.backend == "numpy"
    assert relighter.frame(A).shape == (6, 5, 3)
    # Who asks for it by name gets the error.
    refuses(lambda: Relighter(cast(), backend="gl"), "invalid ", OpenGLError)


NIGHT = Spectrum([390, 710], [0.0, 0.0], name="night")
STOLEN = Spectrum([390, 710], [1.0, -0.1], name="stolen")
ABSOLUTE = RelightSpec(level="absolute")


def relit(lamp: object, *spec: object, **how: object) -> Callable[[], object]:
    return lambda: relight(cast(), lamp, *spec, backend="numpy", **how)


def rig(*lamps: object, **settings: object) -> Callable[[], object]:
    return lambda: LightRig(lamps, **settings)


def closed() -> Relighter:
    """Close it twice."""
    with Relighter(cast(), "numpy") as relighter:
        relighter.close()
    return relighter


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (rig(), "missing LightRig.lights"),
        (rig(A, weights=(0.0,)), "impossible LightRig.weights"),
        (rig(A, weights=(1.0, 2.0)), "shape LightRig.weights"),
        (rig(A, weights=(-1.0,)), "range LightRig.weights[0]"),
        (rig(A, illuminance_lux=(0.0,)), "impossible LightRig.illuminance_lux"),
        (rig("A"), "type LightRig.lights[0]"),
        (lambda: LightRig((A, NIGHT), (), (100.0, 100.0)).mixed(GRID), "conflict "),
        (lambda: LightRig((A, STOLEN)).mixed(GRID), "range "),
        (relit(STOLEN), "range "),
        (relit(NIGHT), "conflict "),
        (relit(A, dtype=np.int8), "type relight.dtype"),
        (relit(A, "exact"), "type RelightSpec.viewing"),
        (relit("A"), "type relight.light"),
        (relit(LightRig((A,), (), (1e30,)), ABSOLUTE), "range illumination.XYZ_from_channels"),
        (relit(A, ABSOLUTE), "missing LightRig.illuminance_lux"),
        (lambda: RelightSpec(mode="exakt"), "unknown RelightSpec.mode"),
        (lambda: RelightSpec(backdrop="grey"), "type RelightSpec.backdrop"),
        (lambda: Relighter(cast(), backend="vulkan"), "unknown Relighter.backend"),
        (lambda: Illumination(np.eye(3), [1, 2], np.ones(3)), "shape illumination.white_XYZ"),
        (lambda: closed().frame(A), "state Relighter"),
        (lambda: closed().update(cast()), "state Relighter"),
    ],
)
def test_an_unlit_rig_and_other_bad_arguments_are_refused(make, fault):
    refuses(make, fault)


def test_pictures_of_another_size_are_refused_by_both_backends(backend):
    first, taller = cast(), cast(height=7)
    with Relighter(first, backend) as relighter:
        refuses(lambda: relighter.update(taller), "shape relight", ShapeError)
        packed = TexturePlanes.of(taller)
        refuses(lambda: relighter.update(first, packed), "shape relight.packed", ShapeError)
    packed = TexturePlanes.of(cast(size=9))
    refuses(lambda: Relighter(first, backend, packed=packed), "shape relight.packed", ShapeError)
    lit = Illumination.of(first.basis, A, RelightSpec())
    if backend == "gl":  # an engine alone has nothing to measure a viewing from
        with Relighter(first, backend) as relighter, raises(ViewingError):
            relighter._engine.render(lit, Viewing(adapting="picture"), np.uint8)


def test_a_vtk_window_opened_between_frames_does_not_blank_them():
    """VTK's first window ends every earlier context of the display, and no call reports it."""
    gl_or_skip(cast()).close()
    script = """
import numpy as np
from tests.support.relighting import cast, gl_or_skip
from volspec import light
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow
import vtkmodules.vtkRenderingOpenGL2
relighter, another = gl_or_skip(cast()), gl_or_skip(cast())
another.close()
before = relighter.frame(light("A"))
window = vtkRenderWindow()
window.SetOffScreenRendering(True)
window.AddRenderer(vtkRenderer())
window.Render()
assert before.any() and np.array_equal(relighter.frame(light("A")), before)
# Nor is the context lent again that the other one gave back.
another = gl_or_skip(cast())
assert np.array_equal(another.frame(light("A")), before)
another.close()
relighter.close()
window.Render()
"""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", script], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
