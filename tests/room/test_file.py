"""Rooms from TOML: surfaces, lights of three kinds, furniture, meshes."""

from pathlib import Path

import numpy as np
import pytest
import pyvista

from tests.support.errors import raises
from volspec.errors import InputError
from volspec.room import load_room, lux_from_irradiance
from volspec.room.file import paint_named
from volspec.spectra import DEFAULT_GRID, light, reflectance

ROOMS = Path(__file__).parents[2] / "data" / "rooms"
START = """size_m = [4.0, 5.0, 2.7]
surface = [
    { name = "walls", reflectance = "grey:0.7" },
    { name = "back", reflectance = "#f0d9b5" },
    { name = "floor", reflectance = "grey:0.3" },
    { name = "ceiling", reflectance = "grey:0.8" },
    { name = "chair", reflectance = "copper" },
]
"""
LAMP = '[[light]]\nname = "lamp"\nspectrum = "A"\n'
BOX = 'lumen = 3\n[[box]]\nname = "{}"\nlow_m = [1, 1, 1]\nhigh_m = [{}, 2, 2]\n'
SMALL = LAMP + "position_m = [1, 1, 1]\n"


def room_file(folder: Path, text: str) -> Path:
    path = folder / "room.toml"
    path.write_text(START + text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["study", "beige-tungsten"])
def test_shipped_rooms_are_closed(name):
    room = load_room(ROOMS / f"{name}.toml")
    assert room.mesh.names[0] == "left" and room.eye is not None and room.title
    assert room.reflectance("table").max() < 1


def test_a_side_of_its_own_is_not_the_walls(tmp_path):
    room = load_room(room_file(tmp_path, SMALL + "lumen = 900\n"))
    assert room.reflectance("left") == pytest.approx(0.7)
    back = room.reflectance("back")
    assert back[-1] > 1.2 * back[0]
    assert lux_from_irradiance(room.lamps[0].intensity) == pytest.approx(900 / (4 * np.pi))


def test_panels_emit_what_is_asked(tmp_path):
    place = 'on = "left"\nplace_m = [1, 0.9, 2, 1.4]\n'
    for strength in ("lux = 500\n", "lumen = 1400\n"):
        panel = load_room(room_file(tmp_path, LAMP + place + strength)).exitances["lamp"]
        assert lux_from_irradiance(panel) == pytest.approx(500)
    lamp = '[[light]]\nname = "lamp"\nspectrum = "lamp:tungsten-2850"\non = "ceiling"\nwatt = 100\n'
    ceiling = load_room(room_file(tmp_path, lamp)).exitances["ceiling"]
    assert lux_from_irradiance(ceiling) == pytest.approx(1500 / 20)
    shape = ceiling / light("lamp:tungsten-2850").values
    assert shape == pytest.approx(shape[0])


def test_the_sun_enters_through_windows(tmp_path):
    window = LAMP.replace("lamp", "pane") + 'on = "right"\nplace_m = [1, 1, 1, 1]\nlux = 9\n'
    sun = LAMP + "azimuth_deg = 90\nelevation_deg = 30\nlux = 50000\n"
    room = load_room(room_file(tmp_path, window + sun))
    (beam,) = room.suns
    assert beam.direction == pytest.approx((np.sqrt(0.75), 0, 0.5))
    assert beam.through == {room.mesh.names.index("pane")}
    assert lux_from_irradiance(beam.irradiance) == pytest.approx(50000)


def test_furniture_from_a_file_is_scaled_and_moved(tmp_path):
    pyvista.Box(bounds=(0, 500, 0, 500, 0, 1000)).triangulate().save(tmp_path / "chair.ply")
    mesh = '[[mesh]]\nname = "chair"\nfile = "chair.ply"\nunit_m = 0.001\nmove_m = [1, 2, 0.1]\n'
    room = load_room(room_file(tmp_path, SMALL + "lumen = 900\n" + mesh))
    chair = room.mesh.part(room.mesh.surface == room.mesh.names.index("chair"))
    points = chair.corners_m.reshape(-1, 3)
    assert points.min(axis=0) == pytest.approx([1, 2, 0.1])
    assert points.max(axis=0) == pytest.approx([1.5, 2.5, 1.1])


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (SMALL, "conflict"),
        (SMALL + "lux = 3\n", "conflict"),
        (SMALL + 'on = "left"\nlumen = 3\n', "conflict"),
        (SMALL + "lumen = 3\nwatt = 3\n", "conflict"),
        (LAMP + "azimuth_deg = 3\nlumen = 3\n", "conflict"),
        (SMALL + "watt = 3\n", "missing"),
        (LAMP + 'on = "left"\nplace_m = [9, 0, 1, 1]\nlux = 3\n', "range"),
        (SMALL + BOX.format("chair", 0), None),
        (SMALL + 'lumen = 3\n[[mesh]]\nname = "chair"\nfile = "none.ply"\n', "not-found"),
        (SMALL + 'lumen = 3\n[[mesh]]\nname = "chair"\nfile = "room.toml"\n', None),
        (SMALL + BOX.format("bed", 2), "missing"),
        ((LAMP + 'on = "ceiling"\nlux = 100\n') * 2, "duplicate"),
        (SMALL.replace('"A"', '"puce"') + "lumen = 3\n", None),
    ],
)
def test_rooms_with_a_fault_are_refused(tmp_path, text, code):
    with raises(InputError, code):
        load_room(room_file(tmp_path, text))


def test_lights_of_one_side_add_up(tmp_path):
    lamp = LAMP + 'on = "ceiling"\nlux = 100\n'
    room = load_room(room_file(tmp_path, lamp + lamp.replace("lamp", "other")))
    assert lux_from_irradiance(room.exitances["ceiling"]) == pytest.approx(200)


def test_a_room_may_be_open(tmp_path):
    path = room_file(tmp_path, SMALL + "lumen = 3\n")
    assert not load_room(path).open
    path.write_text("open = true\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_room(path).open


def test_a_paint_is_a_library_s_reflectance_or_a_colour(tmp_path):
    """Gold is in the library; salmon is a colour, #fa8072."""
    gold, salmon, codes = (
        paint_named(text, DEFAULT_GRID, tmp_path) for text in ("gold", "salmon", "#fa8072")
    )
    assert gold.values == pytest.approx(reflectance("gold").values)
    assert salmon.values == pytest.approx(codes.values)
