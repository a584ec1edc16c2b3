"""Light distributions of luminaires: IES LM-63 and EULUMDAT, alone and as lamps of rooms."""

from pathlib import Path

import numpy as np
import pytest

from tests.room.test_file import LAMP, room_file
from tests.support.errors import raises
from volspec.errors import RoomError, SpectrumError
from volspec.room import Room, RoomLight, load_room, lux_from_irradiance, solve_room
from volspec.room.beam import Beam, read_beam
from volspec.room.direct_light import beam_irradiance
from volspec.room.form_factors import Rays
from volspec.room.mesh import SIDES, box
from volspec.room.model import PointLamp
from volspec.spectra import DEFAULT_GRID, read_spectrum

BANDS = DEFAULT_GRID.size
GAMMA = (0, 30, 60, 90, 120, 150, 180)


def ies(
    rows: dict[float, list[float]],
    gamma: tuple[float, ...] = GAMMA,
    *,
    scale: float = 1,
    tilt: str = "NONE",
    photometry: int = 1,
    edition: str = "IESNA:LM-63-2002",
    factor: float = 1,
) -> str:
    values = "\n".join(" ".join(map(str, row)) for row in rows.values())
    return (
        f"{edition}\n[TEST] 1\n[MANUFAC] Lamps\nTILT={tilt}\n"
        f"1 -1 {scale:g} {len(gamma)} {len(rows)} {photometry} 2 0 0 0\n1.0 {factor:g} 20\n"
        f"{' '.join(map(str, gamma))}\n{' '.join(map(str, rows))}\n{values}\n"
    )


def ldt(
    symmetry: int, step: int, rows: list[list[float]], *, flux: float = 2000, sets: int = 1
) -> str:
    planes = 360 // step
    head = ["Lamps", "1", str(symmetry), str(planes), str(step), str(len(GAMMA)), "30"]
    head += ["report", "name", "number", "file", "2024-01-01", *["0"] * 11, "1,0", "0", str(sets)]
    lamps = ["1", "LED", str(flux), "3000", "80", "20"] * sets
    numbers = [*range(0, 360, step), *GAMMA, *(value for row in rows for value in row)]
    body = [str(number).replace(".", ",") for number in numbers]
    return "\r\n".join([*head, *lamps, *["0,5"] * 10, *body]) + "\r\n"


EVEN = ies({0: [100] * 7})
SPOT = ies({0: [1000, 500, 0, 0, 0, 0, 0]})


def beam_file(folder: Path, text: str, name: str = "a.ies") -> Path:
    path = folder / name
    path.write_text(text, encoding="latin-1", newline="")
    return path


def read(folder: Path, text: str, name: str = "a.ies") -> Beam:
    return read_beam(beam_file(folder, text, name))


def along(c_deg: float, gamma_deg: float) -> np.ndarray:
    c, gamma = np.radians([c_deg, gamma_deg])
    return np.array([np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), -np.cos(gamma)])


def candela(beam: Beam, c_deg: float, gamma_deg: float) -> float:
    """Intensity by the file's own flux."""
    return float(beam.relative([along(c_deg, gamma_deg)])[0] * beam.lumen / (4 * np.pi))


def test_the_integral_over_the_sphere_is_the_flux(tmp_path):
    assert read(tmp_path, EVEN).lumen == pytest.approx(400 * np.pi)
    spot = read(tmp_path, SPOT)
    # Directions of a Fibonacci lattice, and the integral by hand.
    count = np.arange(200_000) + 0.5
    z, turn = 1 - 2 * count / len(count), np.pi * (1 + 5**0.5) * count
    flat = np.sqrt(1 - z * z)
    every = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    assert spot.relative(every).mean() == pytest.approx(1.0, rel=1e-4)
    gamma = np.linspace(0, np.pi / 3, 100_001)
    along_meridian = np.interp(gamma, np.radians(GAMMA), [1000, 500, 0, 0, 0, 0, 0])
    by_hand = 2 * np.pi * np.trapezoid(along_meridian * np.sin(gamma), gamma)
    assert spot.lumen == pytest.approx(by_hand, rel=1e-6)
    found = [candela(spot, *way) for way in ((77, 0), (200, 45), (0, 61))]
    assert found == pytest.approx([1000, 250, 0], rel=1e-6, abs=0)


@pytest.mark.parametrize(
    ("angles", "expected"),
    [
        ((0, 45, 90), (4, 4, 4, 4)),
        ((0, 90, 180), (4, 16, 16, 4)),
        ((0, 90, 180, 270, 360), (4, 16, 22, 10)),
        ((0, 90, 180, 270), (4, 16, 22, 10)),
    ],
)
def test_planes_follow_from_the_symmetry_of_their_angles(tmp_path, angles, expected):
    """Each plane has 1 cd, and 1 more for every 10° of C."""
    rows = {angle: [1 + angle % 360 / 10] * 7 for angle in angles}
    beam = read(tmp_path, ies(rows))
    assert [candela(beam, c, 90) for c in (30, 150, 210, 330)] == pytest.approx(expected)
    assert candela(beam, 90, 90) == pytest.approx(10)


@pytest.mark.parametrize(
    ("symmetry", "rows", "expected"),
    [
        (0, (100, 200, 300, 400), (100, 200, 300, 400)),
        (1, (100,), (100, 100, 100, 100)),
        (2, (100, 200, 300), (100, 200, 300, 200)),
        (3, (400, 100, 200), (100, 200, 100, 400)),
        (4, (100, 200), (100, 200, 100, 200)),
    ],
)
def test_eulumdat_has_the_planes_of_its_symmetry(tmp_path, symmetry, rows, expected):
    """Candelas for 1000 of 2000 lm, by file and at C 0, 90, 180 and 270."""
    beam = read(tmp_path, ldt(symmetry, 90, [[row] * 7 for row in rows]), "a.ldt")
    found = [candela(beam, plane, 60) for plane in (0, 90, 180, 270)]
    assert found == pytest.approx(np.multiply(2, expected))


def test_a_factor_scales_the_candelas_and_decimal_commas_are_read(tmp_path):
    old = ies({0: [100] * 7}, scale=2, edition="IESNA:LM-63-1995", factor=0.5)
    assert read(tmp_path, old).lumen == pytest.approx(400 * np.pi)
    new = ies({0: [100] * 7}, scale=2, edition="IES:LM-63-2019", factor=1.10001)
    assert read(tmp_path, new).lumen == pytest.approx(800 * np.pi)
    european = ldt(1, 90, [[79.5] * 7], sets=2)
    assert read(tmp_path, european, "a.ldt").lumen == pytest.approx(636 * np.pi)


def test_light_falls_off_with_the_square_and_the_cosine_along_the_beam(tmp_path):
    mesh = box((0, 0, 0), (4, 4, 4), SIDES, inside=True)
    rays, dark, up = Rays(mesh), np.zeros((6, BANDS)), np.array([[0.0, 0.0, 1.0]] * 2)
    spot = read(tmp_path, SPOT)
    mean = spot.lumen / (4 * np.pi)
    below = np.array([[2.0, 2.0, 0.0], [2.0 + 3 * np.tan(np.radians(30)), 2.0, 0.0]])
    room = Room(mesh, dark, lamps=(PointLamp((2.0, 2.0, 3.0), np.ones(BANDS), beam=spot),))
    [found] = beam_irradiance(room, rays, below, up) * mean
    # 500 cd at 30°, farther by 1 / cos 30°, at cos 30°
    assert found == pytest.approx([1000 / 9, 500 / 9 * np.cos(np.radians(30)) ** 3], rel=1e-4)
    for aim, turn, to in (((1, 0, 0), 0.0, (4, 2, 3)), ((0, 3, 4), 50.0, (2.0, 2.6, 3.8))):
        lamp = PointLamp((2.0, 2.0, 3.0), np.ones(BANDS), beam=spot.aimed(aim, turn))
        way = np.array(to) - lamp.position_m
        assert lamp.beam.relative([way]) == pytest.approx(1000 / mean)
        assert not lamp.beam.relative([-way]).any()


def test_a_beam_is_turned_about_its_aim(tmp_path):
    rows = {0: [1] * 7, 90: [2] * 7, 180: [3] * 7, 270: [4] * 7}
    beam = read(tmp_path, ies(rows))
    parts = beam.candela[:, 0] * 4 * np.pi / beam.integral
    sides = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    assert beam.relative(sides) == pytest.approx(parts[:4])
    assert beam.aimed((0, 0, -2), 90).relative(sides) == pytest.approx(parts[[3, 0, 1, 2]])
    # Upwards, C 0 stays, and C turns the other way.
    assert beam.aimed((0, 0, 1)).relative(sides) == pytest.approx(parts[[0, 3, 2, 1]])


def lit_room(folder: Path, lamp: str) -> Room:
    return load_room(room_file(folder, f"{LAMP}position_m = [2, 2.5, 2.2]\n{lamp}"))


def solved(folder: Path, lamp: str) -> RoomLight:
    return solve_room(lit_room(folder, lamp), 400, rays=1 << 20)


def test_an_even_beam_is_a_lamp_without_one(tmp_path):
    beam_file(tmp_path, EVEN, "even.ies")
    plain = solved(tmp_path, "lumen = 900\n")
    even = solved(tmp_path, 'lumen = 900\nbeam = "even.ies"\n')
    for surface in ("floor", "ceiling", "left"):
        expected = plain.mean_irradiance(surface)
        assert even.mean_irradiance(surface) == pytest.approx(expected, rel=1e-9)


def test_a_lamp_has_the_lumens_asked_for_or_those_of_its_file(tmp_path):
    beam_file(tmp_path, SPOT, "spot.ies")
    own = read_beam(tmp_path / "spot.ies").lumen
    power = "watt = 10\nlumen_per_watt = 80\n"
    for more, lumen in (("", own), ("lumen = 900\n", 900), (power, 800)):
        [lamp] = lit_room(tmp_path, more + 'beam = "spot.ies"\n').lamps
        assert lux_from_irradiance(lamp.intensity) * 4 * np.pi == pytest.approx(lumen)


@pytest.mark.slow
def test_a_spot_lights_what_it_aims_at(tmp_path):
    beam_file(tmp_path, SPOT, "spot.ies")
    spot = 'beam = "spot.ies"\nlumen = 900\n'
    down, left = solved(tmp_path, spot), solved(tmp_path, spot + "aim = [-1, 0, 0]\n")
    for lit, dark, surface in ((down, left, "floor"), (left, down, "left")):
        bright, dim = (lux_from_irradiance(each.mean_irradiance(surface)) for each in (lit, dark))
        assert bright > 2 * dim


SKY = '[[light]]\nname = "sky"\nspectrum = "A"\non = "left"\nlux = 9\nbeam = "spot.ies"\n'
REFUSED = [
    ("a.ies", "no lamp", "damaged"),
    ("a.ies", ies({0: [1] * 7}, tilt="INCLUDE"), "unsupported"),
    ("a.ies", ies({0: [1] * 7}, photometry=2), "unsupported"),
    ("a.ies", ies({0: [1] * 6}), "damaged"),
    ("a.ies", ies({0: [0] * 7}), "damaged"),
    ("a.ies", ies({0: [-1] * 7}), "range"),
    ("a.ies", ies({0: [1e300] * 7}, scale=1e300), "damaged"),
    ("a.ies", ies({0: ["x"] * 7}), "syntax"),
    ("a.ies", ies({0: [1] * 7, 45: [1] * 7}), "unsupported"),
    ("a.ies", ies({90: [1] * 7, 270: [1] * 7}), "unsupported"),
    ("a.ies", ies({0: [1] * 7}, (0, 30, 20, 90, 120, 150, 180)), "damaged"),
    ("a.ies", ies({0: [1] * 2}, (0, 200)), "range"),
    ("a.ies", ies({0: [1]}, (0,)), "range"),
    ("a.ies", EVEN.replace(" 7 1 1 ", " 7.5 1 1 "), "syntax"),
    ("a.ies", EVEN.replace(" 7 1 1 ", " 999999999999 1 1 "), "damaged"),
    ("a.ldt", "a\n" * 20, "damaged"),
    ("a.ldt", ldt(5, 90, [[1] * 7]), "unknown"),
    ("a.ldt", ldt(0, 90, [[1] * 7] * 3), "damaged"),
    ("a.ldt", ldt(1, 90, [["x"] * 7]), "syntax"),
    ("a.ldt", ldt(1, 90, [[1] * 7], flux=-1), "range"),
    ("a.csv", SPOT, "unsupported"),
    # Settings of a room's lamp.
    ("room.toml", "aim = [0, 0, -1]\nlumen = 9\n", None),
    ("room.toml", "turn_deg = 9\nlumen = 9\n", None),
    ("room.toml", 'beam = "spot.ies"\naim = [0, 0, 0]\n', "range"),
    ("room.toml", 'beam = "spot.ies"\nlux = 9\n', "conflict"),
    ("room.toml", 'beam = "spot.ies"\nlumen = 9\nwatt = 9\n', "conflict"),
    ("room.toml", 'beam = "spot.csv"\n', "unsupported"),
    ("room.toml", 'beam = "none.ies"\n', "not-found"),
    ("room.toml", 'beam = "dark.ldt"\n', "missing"),
    ("room.toml", f'beam = "spot.ies"\n{SKY}', None),
]


@pytest.mark.parametrize(
    ("name", "text", "code"), REFUSED, ids=[f"{k}-{name}" for k, (name, *_) in enumerate(REFUSED)]
)
def test_beams_that_cannot_be_used_are_refused_in_one_line(tmp_path, name, text, code):
    beam_file(tmp_path, SPOT, "spot.ies")
    beam_file(tmp_path, ldt(1, 90, [[1] * 7], flux=0), "dark.ldt")
    with raises(RoomError, code):
        if name == "room.toml":
            lit_room(tmp_path, text)
        else:
            read(tmp_path, text, name)


def test_a_beam_is_no_spectrum_and_must_be_there(tmp_path):
    with raises(SpectrumError, "unsupported"):
        read_spectrum(beam_file(tmp_path, SPOT))
    with raises(SpectrumError, "not-found"):
        read_beam(tmp_path / "none.ldt")
