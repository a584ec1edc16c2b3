"""Any scene, written and read again, is the same scene; those that ship to the letter."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.fixtures import slow_each
from tests.support.scenes import comments, lines, read
from volspec.appearance.display.monitors import PRESETS
from volspec.appearance.display.spaces import SPACES as COLOUR_SPACES
from volspec.appearance.spec import MODELS, SURROUNDS
from volspec.scene import Scene, SceneFile, write_scene
from volspec.scene.file import scene_file
from volspec.scene.tables.specs import CameraSpec
from volspec.scene.writing import rebase_scene

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "data" / "scenes").glob("*.toml"))

# Numbers that TOML and Python write apart, and texts that need quotes.
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False) | st.sampled_from([0.0, 1e-9, 1e300, 30.0, 0.2])
POSITIVE = NUMBERS.map(abs)
ABOVE = POSITIVE.filter(bool)
UNIT, WEIGHT = st.floats(0, 1), st.floats(0, 1e6) | st.sampled_from([1e-9, 30.0])
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="=;"), min_size=1, max_size=12)
NAMES = TEXTS.filter(lambda text: bool(text.strip()))
GROUPS = NAMES.filter(lambda text: text.isprintable() and text == text.strip())
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
PAIRS = st.tuples(NUMBERS, NUMBERS)
RISING = st.tuples(NUMBERS, NUMBERS).map(sorted).filter(lambda pair: pair[0] < pair[1])
DIRECTIONS = VECTORS.filter(any)
FLAGS = st.booleans()
FRAMES = st.sampled_from(["world", "camera"])


def some(**keys: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Any of these keys."""
    return st.fixed_dictionaries({}, optional=keys)


def has(needed: dict[str, Any], **keys: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.fixed_dictionaries(needed, optional=keys)


SPECTRA = st.lists(NUMBERS, min_size=2, max_size=20).map(
    lambda values: {"wavelengths_nm": list(range(400, 400 + len(values))), "values": values}
)
MIXES = NAMES | st.dictionaries(NAMES, NUMBERS, min_size=1, max_size=3)
ROW = {"opacity": NUMBERS, "material": MIXES}
POINTS = st.lists(has({"value": NUMBERS, **ROW}), min_size=1, max_size=6)
TRANSFERS = (
    has({"points": POINTS}, gradient_opacity=st.lists(PAIRS, min_size=1, max_size=12))
    | has({"points": POINTS}, reference_step_mm=NUMBERS)
    | has({"surfaces": POINTS})
    | has({"regions": st.lists(has({"values": PAIRS, "gradients": PAIRS, **ROW}), min_size=1)})
    | has(
        {
            "labels": st.lists(
                has({"label": st.integers(0, 65535), **ROW}),
                min_size=1,
                unique_by=lambda row: row["label"],
            )
        }
    )
)
FIELDS = has(
    {"transfer": has({"points": POINTS}, weight=POSITIVE, shown=FLAGS)},
    file=TEXTS,
    downsample=st.integers(1, 4),
)
SOURCES = (
    has({"kind": st.just("ambient")}, occlusion=FLAGS, radius_mm=ABOVE, intensity=WEIGHT)
    | has({"kind": st.just("headlight")}, intensity=WEIGHT)
    | has({"kind": st.just("directional"), "towards": DIRECTIONS}, shadows=FLAGS)
    | has({"kind": st.just("point"), "position_mm": VECTORS}, falloff_mm=ABOVE, frame=FRAMES)
)
CAMERAS = some(azimuth_deg=NUMBERS, zoom=ABOVE, up=DIRECTIONS) | has(
    {"position_mm": VECTORS}, fov_deg=st.floats(1, 179), target_mm=VECTORS
)
BASES = (
    has({"name": TEXTS})
    | some(size=st.integers(3, 16), train=st.just("scene"), positive=FLAGS, grid_nm=VECTORS)
    | has({"method": st.just("materials")}, observer_deg=st.just(10))
)
SPACES = st.sampled_from(list(COLOUR_SPACES)) | has(
    {
        "primaries_xy": st.tuples(*(st.just(xy) for xy in COLOUR_SPACES["DCI-P3"].primaries_xy)),
        "white_xy": st.tuples(st.floats(0.3, 0.33), st.floats(0.3, 0.33)),
        "transfer": st.floats(0.5, 3) | has({"power": st.floats(0.4, 1)}, toe=st.just(0)),
    }
)
VIEWINGS = some(
    model=st.sampled_from(MODELS),
    exposure=st.floats(1e-6, 1e6),
    surround=st.sampled_from(list(SURROUNDS)) | UNIT,
    backdrop=UNIT,
    D=UNIT,
    filter=st.sampled_from(["longpass:500", "bandpass:525/50"]),
    display=some(
        preset=st.sampled_from(list(PRESETS)), space=SPACES, mark=FLAGS, L_A=st.floats(0, 1e4)
    ),
)
CASTS = some(
    ambient=WEIGHT,
    shininess=st.integers(1, 1024),
    half=FLAGS,
    crop_voxels=st.tuples(RISING, RISING, RISING),
    clip_planes=st.lists(has({"point_mm": VECTORS, "normal": DIRECTIONS}), max_size=3),
)


@st.composite
def scene_files(draw: st.DrawFn) -> SceneFile:
    transfer = draw(TRANSFERS)
    names = draw(st.lists(NAMES, min_size=1, max_size=3, unique=True))
    materials = [{"name": name, "reflectance": draw(TEXTS | SPECTRA)} for name in names]
    if "points" in transfer and draw(FLAGS):
        materials[0]["filter"] = draw(TEXTS | SPECTRA)
    groups = draw(st.lists(GROUPS, max_size=2, unique=True))
    places = [None, *(groups or ["light"])]
    lights = draw(
        st.lists(
            st.tuples(NAMES, st.sampled_from(places)), min_size=1, max_size=4, unique_by=lambda p: p
        )
    )
    lit = draw(FLAGS)
    others = draw(st.lists(GROUPS, max_size=2, unique=True)) if "points" in transfer else []
    data = {
        "title": draw(st.text(st.characters(codec="utf-8"), max_size=9)),
        "volume": draw(has({"file": TEXTS}, spacing_mm=VECTORS, downsample=st.integers(1, 4))),
        "material": materials,
        "transfer": transfer,
        "field": [{"name": name, **draw(FIELDS)} for name in others],
        "basis": draw(BASES),
        "camera": draw(CAMERAS),
        "raycast": draw(CASTS),
        "group": [
            {"name": name, "sources": draw(st.lists(SOURCES, min_size=1, max_size=3))}
            for name in groups
        ],
        "light": [
            {"name": name, "spectrum": draw(TEXTS | SPECTRA), "weight": draw(POSITIVE)}
            | ({"group": group} if group else {})
            | ({"illuminance_lux": draw(POSITIVE)} if lit else {"label": draw(TEXTS)})
            for name, group in lights
        ],
        "viewing": draw(VIEWINGS),
        "output": draw(some(width=st.integers(1, 8192))),
    }
    return scene_file(data, "scene.toml")


def is_written_into(file: SceneFile, shipped: Path, folder: Path) -> None:
    """Check that a scene reads back, and that the lines at the top of a file stay above it."""
    assert read(write_scene(file, folder / "any.toml")) == file
    source = folder / shipped.name
    shutil.copy(shipped, source)
    path = write_scene(file, folder / "into.toml", Unresolved(read(source), source))
    assert read(path) == file
    assert lines(path)[:2] == lines(shipped)[:2]


@pytest.mark.not_quick
@pytest.mark.parametrize("count", [15, *slow_each(300)])
def test_any_scene_reads_back_and_is_written_into_any_file(tmp_path, count):
    @settings(max_examples=count, suppress_health_check=[HealthCheck.too_slow])
    @given(scene_files(), st.sampled_from(SHIPPED))
    def check(file: SceneFile, shipped: Path) -> None:
        is_written_into(file, shipped, tmp_path)

    check()


def test_stated_defaults_make_way_for_what_contradicts_them(tmp_path):
    """The foot's camera has the default's angles, which a place replaces."""
    shipped = next(path for path in SHIPPED if path.name == "foot.toml")
    placed = CameraSpec(position_mm=(0.0, 0.0, 900.0))
    is_written_into(replace(read(shipped), camera=placed), shipped, tmp_path)


class Unresolved(Scene):
    """A scene whose spectra nobody looks up: writing wants names only."""

    def __init__(self, file: SceneFile, path: Path) -> None:
        self.file, self.path, self.folder, self._known = file, path, path.parent, {}


@pytest.mark.not_quick
@pytest.mark.parametrize("shipped", SHIPPED, ids=lambda path: path.stem)
def test_a_scene_that_ships_is_written_as_it_stands(tmp_path, shipped):
    """Next to it letter by letter; elsewhere its paths lead back, its comments stay."""
    copied = tmp_path / "scenes" / shipped.name
    copied.parent.mkdir()
    shutil.copy(shipped, copied)
    like = Unresolved(read(copied), copied)
    again = write_scene(like.file, copied.with_name("again.toml"), like)
    assert again.read_bytes() == shipped.read_bytes()
    away = write_scene(like.file, tmp_path / "a" / "b" / "away.toml", like)
    assert rebase_scene(read(away), away.parent, copied) == like.file
    assert comments(away.read_text("utf-8")) == comments(shipped.read_text("utf-8"))
    assert lines(away)[0] == "#:schema ../../scenes/scene.schema.json"
    assert read(write_scene(like.file, tmp_path / "again.toml")) == like.file
