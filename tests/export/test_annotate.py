"""Marks in saved pictures: the bar's length, their place, and what they leave as it was."""

from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.support.images import image
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.camera.projection import Projection, length_mm, length_text, scale_text
from volspec.errors import VolspecWarning
from volspec.export import tiles
from volspec.export.annotate import MarkedPicture, annotation_svg, paint, picture_marks
from volspec.export.exporter import export
from volspec.export.value_bars import material_colours, value_bars
from volspec.pipeline import relight
from volspec.relight import LightRig, RelightSpec
from volspec.scene.tables.annotation import Annotation, measured_length
from volspec.scene.tables.export import MARKS
from volspec.spectra import light, reflectance
from volspec.transfer import FieldFunctions, Isosurfaces, TransferFunction
from volspec.volume import Metadata, Volume, phantom

VOLUME = phantom.ball(16)
CAMERA = Camera.orbit(VOLUME, azimuth_deg=20.0)
POINTS = ((2.0, 2.0, 2.0), (12.0, 5.0, 9.0))


def marked(size: tuple[int, int], *marks: Any, **names: Any) -> NDArray[np.uint8]:
    """Return a grey picture with marks."""
    picture = MarkedPicture(size, CAMERA, VOLUME, **names)
    grey = np.full((*size[::-1], 3), 128, np.uint8)
    return paint(grey, picture_marks(marks, picture))


@pytest.mark.parametrize("size", [(320, 240), (1000, 400), (60, 400), (2400, 1800)])
def test_a_scale_bar_has_the_length_that_it_names(size):
    picture = marked(size, "scale")
    rows = (picture == 255).all(axis=-1).sum(axis=1)
    mm_per_px = Projection(CAMERA, (0, 0, *size)).mm_per_px
    wanted = length_mm(mm_per_px, max(min(0.25 * size[0], 180 * max(min(size) / 720, 0.6)), 1))
    assert rows.max() == pytest.approx(wanted / mm_per_px, abs=0.5)


def test_lengths_of_all_sizes_are_legible_numbers_of_their_unit():
    sizes = {"km": 6, "m": 3, "cm": 1, "mm": 0, "µm": -3, "nm": -6, "pm": -9, "fm": -12}
    for mm in 2.0 * 10.0 ** np.arange(-12, 14):
        for text in (length_text(mm), measured_length(mm)):
            number, unit = text.replace(",", "").split()
            assert float(number) * 10.0 ** sizes[unit] == pytest.approx(mm)
            assert "e" not in number and float(number) >= 0.1


def test_a_scale_bar_says_that_lengths_are_assumed():
    guessed = replace(VOLUME, metadata=Metadata(assumed=("slices 4 mm apart",)))
    assert scale_text(5.0, guessed) != scale_text(5.0, VOLUME) == "5 mm"
    assert scale_text(5.0, guessed.with_spacing((1, 1, 4))) == "5 mm"


@pytest.mark.parametrize("mark", [mark for mark in MARKS if mark != "values"])
def test_marks_are_in_their_corners(mark):
    right, low = mark in ("scale", "orientation"), mark in ("scale", "materials")
    names = {"title": "A ball", "light": "D65", "materials": {"gold": np.array([0.9, 0.7, 0.2])}}
    for size in ((800, 600), (200, 150)):
        drawn = (marked(size, mark, **names) != 128).any(axis=-1)
        y, x = np.nonzero(drawn)
        assert drawn.sum() > 100
        assert (x > size[0] / 2).all() if right else (x < size[0] / 2).all(), mark
        assert (y > size[1] / 2).all() if low else (y < size[1] / 2).all(), mark


def test_materials_without_room_are_counted_and_pictures_of_any_size_can_be_marked():
    many = {f"material {i}": np.array([i / 99, 0.0, 0.5]) for i in range(99)}
    picture = marked((300, 200), "materials", materials=many)
    assert np.array_equal(picture[:8], np.full_like(picture[:8], 128))
    names = {"title": "x" * 500, "light": "\u202e", "materials": many}
    for size in ((1, 1), (2, 300), (300, 2)):
        assert marked(size, *MARKS, **names).shape == (size[1], size[0], 3)


def test_material_colours_are_those_of_a_frame_of_a_flat_material():
    basis, gold, seen = (
        SpectralBasis.load("general-7"),
        reflectance("gold"),
        RelightSpec(mode="exact"),
    )
    flat = image(basis.analyse(gold)[None, None], basis)
    for name in ("D65", "A"):
        frame = relight(flat, light(name), seen, backend="numpy")
        rig = LightRig((light(name),))
        found = material_colours({"gold": gold}, basis, rig, seen, {"": 1.0})
        assert 255 * found["gold"] == pytest.approx(frame[0, 0].astype(float), abs=3)


def test_value_bars_have_the_colours_of_values_and_name_their_field():
    basis, rig = SpectralBasis.load("general-7"), LightRig((light("A"),))
    metals = {name: reflectance(name) for name in ("gold", "copper")}
    curve = TransferFunction([(1, 0, "gold"), (2, 0.1, "gold"), (4, 0.2, "copper")], metals, basis)
    ramp = np.linspace(0, 5, 64, dtype=np.float32).reshape(4, 4, 4)
    volts = Volume(ramp, name="U", metadata=Metadata(unit="V"))
    levels = Isosurfaces([(2.0, 1.0, "gold")], metals, basis)
    how = basis, rig, RelightSpec(), {"": 1.0}
    (bar,) = value_bars(curve, Volume(ramp), *how)
    own = material_colours(metals, *how)
    assert (bar.low, bar.high) == pytest.approx((1, 4), abs=0.01) and bar.ticks() == [1, 2, 3, 4]
    np.testing.assert_allclose(bar.colours[[1, -1]], [own["gold"], own["copper"]], atol=0.02)
    both = FieldFunctions({"": curve, "U": curve})
    titles = [each.title for each in value_bars(both, Volume(ramp, name="I", fields=[volts]), *how)]
    assert titles == ["I", "U · V"] and not value_bars(levels, Volume(ramp), *how)


def test_transparent_pictures_get_opaque_marks():
    patches = picture_marks(("scale",), MarkedPicture((320, 240), CAMERA, VOLUME))
    clear = np.zeros((240, 320, 4), np.uint16)
    clear[..., :3] = 1000
    drawn = paint(clear, patches)
    bar = (drawn[..., :3] == 65535).all(axis=-1)
    assert bar.any() and (drawn[bar][:, 3] == 65535).all()
    assert (drawn[:100] == clear[:100]).all() and (clear[..., 3] == 0).all()


def test_strips_of_a_large_picture_have_the_marks_of_the_whole(scene, tmp_path, monkeypatch):
    settings: dict[str, Any] = {"lights": ["day"], "size": (200, 256), "annotate": MARKS}
    export(scene(), tmp_path / "whole", **settings)
    monkeypatch.setattr(tiles, "STRIP_BYTES", 200 * 64 * 4 * 8)
    export(scene(), tmp_path / "strips", **settings)
    plain = export(scene(), tmp_path / "plain", **settings | {"annotate": ()})
    whole, strips, bare = (
        np.asarray(Image.open(tmp_path / name / plain.files[0]))
        for name in ("whole", "strips", "plain")
    )
    assert np.array_equal(whole, strips) and (whole != bare).any()


@pytest.mark.parametrize("size", [(800, 600), (3000, 2000), (120, 90)])
def test_annotations_are_where_their_points_are(size):
    picture = marked(size, annotations=[Annotation(points_mm=POINTS)])
    start, end = Projection(CAMERA, (0, 0, *size)).to_window(np.array(POINTS))[:, :2]
    for share in (0.0, 0.3, 1.0):  # the caption is near the middle
        x, y = (start + share * (end - start)).astype(int)
        near = picture[y - 1 : y + 2, x - 1 : x + 2]  # lines of small pictures are thin
        assert near.min(axis=-1).max() > 200
    assert (picture[0] == 128).all() and (picture == 0).any()


def test_an_annotation_that_is_cut_is_named():
    long = Annotation(points_mm=POINTS, text="y" * 80)
    with pytest.warns(VolspecWarning, match=r"\[\[annotation\]\] 'y+"):
        narrow = marked((512, 512), annotations=[long])
    wide = marked((1500, 512), annotations=[long])
    assert (narrow[:, -1] != 128).any() and (wide[:, -1] == 128).all()
    svg = annotation_svg([long], CAMERA, (512, 512))
    assert f">{long.caption}<" in svg, "the number follows the text"


def test_an_annotation_behind_the_camera_is_not_drawn():
    behind = tuple(2 * np.array(CAMERA.position_mm) - np.array(CAMERA.target_mm))
    picture = marked((80, 60), annotations=[Annotation(points_mm=(behind,), text="here")])
    assert (picture == 128).all()


def test_a_page_s_marks_are_where_a_picture_s_are():
    rows = [Annotation(points_mm=POINTS, text="a < b"), Annotation(points_mm=POINTS[:1], text="c")]
    drawn = ElementTree.fromstring(f"<svg>{annotation_svg(rows, CAMERA, (800, 600))}</svg>")
    assert [each.text for each in drawn.iter("text")] == [rows[0].caption, "c"]
    ends = Projection(CAMERA, (0, 0, 800, 600)).to_window(np.array(POINTS))[:, :2]
    line = next(drawn.iter("line"))
    placed = [[float(line.get(f"{axis}{end}", "nan")) for axis in "xy"] for end in (1, 2)]
    assert np.abs(np.array(placed) - ends).max() < 0.06
