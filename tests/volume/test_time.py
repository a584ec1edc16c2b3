"""Time steps: files of several and files of one each, one range for all, gaps and faults."""

import pickle
from copy import copy, deepcopy
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
import tifffile

import volspec as vs
from tests.support.errors import raises, warns
from volspec.errors import SceneError, VolumeError
from volspec.export.frames import read_frame
from volspec.volume.labels import Label
from volspec.volume.series import Series, load_at, open_volume, step_addresses

SCENE = """
version = 2
volume.file = "{file}"
material = [{{ name = "a", reflectance = "copper" }}]
transfer.points = [
    {{ value = 20, opacity = 0, material = "a" }}, {{ value = 90, opacity = 0.5, material = "a" }},
]
light = [{{ name = "day", spectrum = "D65" }}, {{ name = "night", spectrum = "A" }}]
basis.name = "general-7"
output = {{ width = 24, height = 20 }}
{more}
"""
TWO_COUNTS = "export.play.frames = 5\nexport.turntable.frames = 6"
LATE = """
[[field]]
name = "late"
file = "{file}"
transfer.points = [{{ value = 20, opacity = 0.2, material = "a" }}]
"""
SIZES = {f"PhysicalSize{axis}": 1.0 for axis in "XYZ"}
UNEVEN = LATE.format(file="beat[89]*.nrrd")


def scene(folder: Path, more: str = "", file: str = "beat*.nrrd") -> vs.Scene:
    (folder / "scene.toml").write_text(SCENE.format(file=file, more=more))
    return vs.Scene.load(folder / "scene.toml")


def steps(count: int = 4) -> list[np.ndarray]:
    """Balls that grow, and are brighter every time."""
    z, y, x = np.mgrid[:12, :12, :12] - 5.5
    away = np.sqrt(z**2 + y**2 + x**2)
    return [((away < 2 + k) * (60 + 40 * k)).astype(np.uint8) for k in range(count)]


@pytest.fixture
def beat(tmp_path: Path) -> Path:
    """Four files of one step each."""
    for number, values in enumerate(steps()):
        image = SimpleITK.GetImageFromArray(values)
        SimpleITK.WriteImage(image, tmp_path / f"beat{number + 8}.nrrd")
    return tmp_path


def test_a_sequence_of_slicers_is_a_series(tmp_path):
    stack = np.stack(steps(), axis=-1)
    head = (
        "NRRD0005\ntype: uint8\ndimension: 4\nsizes: 4 12 12 12\nencoding: raw\n"
        "kinds: list domain domain domain\nspace: left-posterior-superior\n"
        "space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n"
        "axis 0 index type:=numeric\naxis 0 index values:=0 1 2 3\n\n"
    )
    path = tmp_path / "beat.seq.nrrd"
    path.write_bytes(head.encode() + stack.tobytes())
    assert np.array_equal([each.values for each in vs.load_series(path)], steps())


def test_files_by_a_pattern_are_steps_in_the_order_of_their_numbers(beat):
    series = vs.load_series(beat / "beat*.nrrd")
    assert len(series) == 4 and series.names[-1].endswith("beat11.nrrd")
    assert np.array_equal([each.values for each in series], steps())
    assert {each.range for each in series} == {(0.0, 180.0)} and series[-1].is_step_of(series[0])
    with pytest.raises(IndexError):
        series[4]


def test_series_and_their_steps_are_pickled_and_copied(beat):
    for series in (vs.load_series(beat / "beat*.nrrd"), Series(steps())):
        for again in (pickle.loads(pickle.dumps(series)), deepcopy(series), copy(series)):
            assert np.array_equal([each.values for each in again], steps())
            step = pickle.loads(pickle.dumps(again[1]))
            assert step.range == (0.0, 180.0) and step.is_step_of(again[0])
            assert not step.values.flags.writeable


def test_a_4d_file_is_a_series_and_a_step_of_it_a_volume(tmp_path):
    stack = [[each, each // 2] for each in steps()]
    path = tmp_path / "heart.ome.tif"
    notes = {"axes": "TCZYX", "Channel": {"Name": ["a", "b"]}, **SIZES}
    tifffile.imwrite(path, np.array(stack), metadata=notes)
    assert step_addresses(str(path)) == tuple(f"{path}?time={k}" for k in range(4))
    volume, series = open_volume(str(path))
    assert volume.by_name.keys() == {str(path), "b"}
    assert series[3].fields[0].range == (0.0, 90.0) and series[0].range == (0.0, 180.0)
    assert open_volume(f"{path}?time=2")[1] is None
    assert np.array_equal(load_at(str(path), 2, 4, {}).values, steps()[2])


def test_a_truncated_step_is_named_and_the_rest_plays(beat):
    whole = (beat / "beat9.nrrd").read_bytes()
    (beat / "beat9.nrrd").write_bytes(whole[: len(whole) // 2])
    with warns("beat9.nrrd is left out"):
        series = vs.load_series(beat / "beat*.nrrd")
    assert [Path(name).stem for name in series.names] == ["beat8", "beat10", "beat11"]
    assert series[1].values.max() == 140


def test_missing_numbers_are_named(beat):
    (beat / "beat9.nrrd").unlink()
    with warns("no file has the number 9"):
        assert len(step_addresses(str(beat / "beat*.nrrd"))) == 3


def test_types_and_missing_voxels_are_alike_in_all_steps():
    first = vs.Volume(steps()[0])
    holey = steps()[3].astype(np.float32)
    holey[0, 0, 0] = np.nan
    with warns("NaN"):
        last = vs.Volume(holey)
    series = Series([first, last])
    assert series[0].values.dtype == np.float32 and series[0].range == series[1].range
    assert series[1].missing < -1000 and series[1].values[0, 0, 0] == series[1].missing
    assert series[0].is_step_of(series[1])
    labelled = [vs.Volume(steps()[0], labels={k: Label("liver")}) for k in (1, 2)]
    assert not labelled[0].is_step_of(labelled[1])
    assert first.values.dtype == np.uint8  # as it was


def test_steps_have_the_labels_of_all_and_numbers_of_their_own():
    """Cells come and go."""
    values = np.zeros((4, 4, 8), np.uint32)
    values[:2, :, :4], values[2:, :, :4] = 70_001, 5
    later = np.where(values == 5, 600_000_000, values)
    steps = [
        vs.Volume(each, labels={n: Label() for n in ids})
        for each, ids in ((values, (5, 70_001)), (later, (70_001, 600_000_000)))
    ]
    series = Series(steps)
    assert [list(step.labels) for step in series] == 2 * [[5, 70_001, 600_000_000]]
    assert [step.numbers for step in series] == [(0, 5, 70_001), (0, 70_001, 600_000_000)]
    assert not series[0].is_step_of(series[1])


def test_steps_beyond_the_room_are_read_again():
    read: list[int] = []

    def load(number: int) -> vs.Volume:
        read.append(number)
        return vs.Volume(steps()[number])

    series = Series([partial(load, number) for number in range(4)], kept_bytes=2 * 12**3)
    assert read == [0, 1, 2, 3]
    assert series[3].values.max() == 180 and read == [0, 1, 2, 3]
    assert series[0].values.max() == 60 and read == [0, 1, 2, 3, 0]


def test_a_scene_shows_a_step_and_exports_all(beat):
    made_of = scene(beat, "volume.step = 2")
    assert made_of.step_count() == 4 and made_of.volume().values.max() == 140
    lights = {"lights": ["day"], "sheet": False}
    made = vs.export(made_of, beat / "frames", play={"loops": 2}, **lights)
    assert made.frames == 8 and made.casts == 4
    frames = [(made.output / name).read_bytes() for name in made.files]
    assert frames[:4] == frames[4:] and len(set(frames)) == 4
    for count in (6, 0):
        turned = vs.export(made_of, beat / "turn", turntable={"frames": 6}, play={}, **lights)
        assert (turned.frames, turned.casts, turned.made) == (6, 6 * bool(count), count)
    own, as_step = (
        vs.raycast(volume, made_of.transfer, made_of.camera(volume), (24, 20), made_of.raycast)
        for volume in (made_of.volume(), made_of.series()[2])
    )
    assert np.abs(own.coefficients - as_step.coefficients).max() < 1e-5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*quality balanced asks for an error of")  # hard edges
def test_a_scene_made_for_a_series_fits_all_steps(tmp_path):
    """The first step may be empty; the camera frames what the last one shows."""
    steps_of = [np.zeros((12, 12, 12), np.uint8), *steps(3)]
    path = tmp_path / "growing.nrrd"
    series = SimpleITK.JoinSeries([SimpleITK.GetImageFromArray(each) for each in steps_of])
    SimpleITK.WriteImage(series, path)
    scene = vs.Scene.from_volume(path, lights=["D65"])
    made = scene.series()
    assert made[0].values.max() == 0 and made[0].range == (0.0, 140.0)
    last = scene.render(made[3], size=(64, 64))
    edges = [last.alpha[0], last.alpha[-1], last.alpha[:, 0], last.alpha[:, -1]]
    assert last.alpha.max() > 0.5 and max(edge.max() for edge in edges) < 0.01
    alone = vs.Scene.from_volume(f"{path}?time=3", lights=["D65"])
    assert alone.file.camera.zoom == pytest.approx(scene.file.camera.zoom, rel=0.1)


def test_a_frame_is_the_picture_of_its_step_whichever_was_cast_before(beat):
    series, settings = scene(beat), {"lights": ["day"], "sheet": False}
    made = vs.export(series, beat / "frames", play={}, **settings)
    alone = vs.export(scene(beat, "volume.step = 3"), beat / "alone", **settings)
    frame = (made.output / made.files[3]).read_bytes()
    own = read_frame(alone.output / alone.files[0])
    assert np.array_equal(read_frame(made.output / made.files[3]), own)
    for name in made.files[1:]:
        (made.output / name).unlink()
    assert vs.export(series, made.output, play={}, **settings).made == 3
    assert frame == (made.output / made.files[3]).read_bytes()


def test_a_further_field_is_a_series_too_without_a_step_that_cannot_be_read(beat):
    for number in range(8, 12):
        (beat / f"late{number}.nrrd").write_bytes((beat / f"beat{number}.nrrd").read_bytes())
    (beat / "late10.nrrd").write_bytes((beat / "beat10.nrrd").read_bytes()[:-60])
    with warns("beat10.nrrd is left out", "late10.nrrd"):
        series = scene(beat, LATE.format(file="late*.nrrd")).series()
    greatest = [(each.values.max(), each.fields[0].values.max()) for each in series]
    assert greatest == [(60, 60), (100, 100), (180, 180)]


def test_a_field_that_is_no_series_is_read_once(beat):
    series = scene(beat, '[[field]]\nname = "still"\nfile = "beat8.nrrd"\n').series()
    assert np.shares_memory(series[0].fields[0].values, series[3].fields[0].values)


def volume(**more: str) -> vs.Volume:
    return vs.Volume(steps()[0], **more)


def four_steps(folder: Path) -> str:
    """Write all steps to one file; return its address."""
    path = folder / "heart.ome.tif"
    tifffile.imwrite(path, np.stack(steps()), metadata={"axes": "TZYX", **SIZES})
    return str(path)


@pytest.mark.parametrize(
    ("take", "error", "code"),
    [
        (lambda _: Series([volume(), vs.Volume(steps()[1][:, :, 1:])]), VolumeError, "shape"),
        (
            lambda _: Series([volume(), volume().with_fields([volume(name="b")])]),
            VolumeError,
            "conflict",
        ),
        (lambda _: Series([]), VolumeError, "missing"),
        (lambda beat: load_at(four_steps(beat), 2, 3, {}), VolumeError, "shape"),
        (lambda beat: vs.load_series(f"{four_steps(beat)}?time=2"), VolumeError, "missing"),
        (lambda beat: step_addresses(f"{beat}/none*.nrrd"), VolumeError, "not-found"),
        (
            lambda beat: vs.export(scene(beat, file="beat8.nrrd"), beat, play={}),
            SceneError,
            "conflict",
        ),
        (lambda beat: scene(beat, "volume.step = 4").volume(), SceneError, "range"),
        (lambda beat: scene(beat, TWO_COUNTS), SceneError, "conflict"),
        (lambda beat: scene(beat, UNEVEN).series(), SceneError, "shape"),
    ],
)
def test_what_is_no_series_and_cannot_play_is_refused(beat, take, error, code):
    with raises(error, code) as caught:
        take(beat)
    assert str(caught.value).count("scene.toml") == (error is SceneError)
