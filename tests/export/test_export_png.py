"""PNG as written here: read back by others to the last bit, colours tagged, whole or not at all."""

import io
import struct
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support.errors import raises
from volspec.appearance.display.spaces import SPACES, to_uint16
from volspec.errors import InputError
from volspec.export.frames import (
    distinct_stems,
    encode,
    file_stem,
    read_frame,
    read_frame_text,
    row_file,
    write_frame,
)
from volspec.export.png import PngWriter


def png(channels: int, bits: int, size: tuple[int, int] = (37, 53), name: str = "sRGB") -> Any:
    return lambda file: PngWriter(file, size, channels, bits, SPACES[name], {})


def picture(dtype: Any, channels: int, size: tuple[int, int] = (37, 53)) -> np.ndarray:
    """Ramps, flats and noise: every filter is taken somewhere."""
    top = np.iinfo(dtype).max
    rng = np.random.default_rng(3)
    y, x = np.mgrid[: size[1], : size[0]]
    codes = np.stack([(x * 7 + y * (c + 1) * 3) * (top // 700) for c in range(channels)], axis=-1)
    codes[10:20] = top // 3
    codes[20:30] = rng.integers(0, top + 1, codes[20:30].shape)
    return codes.astype(dtype)


def chunks(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 8
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        found[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + length]
        at += 12 + length
    return found


@pytest.mark.parametrize("channels", [3, 4])
def test_eight_bits_are_read_back_by_another_library(channels):
    frame = picture(np.uint8, channels)
    read = Image.open(io.BytesIO(encode(frame, png(channels, 8))))
    assert np.array_equal(np.asarray(read), frame)


@pytest.mark.parametrize("channels", [3, 4])
def test_sixteen_bits_are_read_back_by_another_library(tmp_path, channels):
    import SimpleITK

    frame = picture(np.uint16, channels)
    write_frame(tmp_path / "f.png", frame)
    read = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(tmp_path / "f.png")))
    assert read.dtype == np.uint16 and np.array_equal(read, frame)


def test_rows_in_pieces_are_the_same_picture(tmp_path):
    frame = picture(np.uint16, 3)
    with row_file(tmp_path / "f.png", png(3, 16)) as file:
        for start, end in ((0, 1), (1, 30), (30, 53)):
            file.rows(frame[start:end])
    write_frame(tmp_path / "g.png", frame)
    f, g = (Image.open(tmp_path / name) for name in ("f.png", "g.png"))
    assert f.tobytes() == g.tobytes()


def test_a_picture_that_is_not_finished_is_not_there(tmp_path):
    with suppress(ZeroDivisionError), row_file(tmp_path / "f.png", png(3, 8, (4, 4))) as file:
        file.rows(np.zeros((2, 4, 3), np.uint8))
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_colours_are_told_by_chunk_profile_and_code_points():
    frame = picture(np.uint8, 3)
    plain, wide, other = (
        chunks(encode(frame, png(3, 8, name=name))) for name in ("sRGB", "Display P3", "Rec. 2020")
    )
    assert plain[b"sRGB"] == b"\0" and not {b"iCCP", b"cICP"} & set(plain)
    assert wide[b"cICP"] == bytes([12, 13, 0, 1]) and b"iCCP" in wide
    assert list(wide).index(b"cICP") < list(wide).index(b"IDAT")
    assert b"iCCP" in other and b"cICP" not in other


def test_any_text_is_kept_as_it_is(tmp_path):
    text = {"light": "</script>\"'\u202e é", "Title": "line\nline"}
    write_frame(tmp_path / "f.png", picture(np.uint8, 3), text)
    assert read_frame_text(tmp_path / "f.png") == text


def test_codes_round_to_the_nearest_of_65536():
    codes = np.array([-1, 0, 0.5, 1 - 1e-9, 2, np.nan], np.float64)
    assert to_uint16(codes).tolist() == [0, 0, 32768, 65535, 65535, 0]


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 2), (4, 4, 3, 1), (0, 2, 3)])
def test_what_is_no_frame_is_refused(tmp_path, shape):
    with raises(InputError, "shape"):
        write_frame(tmp_path / "f.png", np.zeros(shape, np.uint8))


@pytest.mark.parametrize("at", [20, 37])
def test_a_damaged_frame_is_refused(tmp_path, at):
    data = encode(np.zeros((9, 9, 3), np.uint8), png(3, 8, (9, 9)))
    (tmp_path / "f.png").write_bytes(data[:at] + b"\xff\x1f" + data[at + 2 :])
    with raises(InputError, "damaged"):
        read_frame(tmp_path / "f.png")


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        '"; rm -rf ~',
        "</script><b>",
        "a\u202egnp.exe",
        "\u2066\u2069",
        "con",
        "x" * 400,
        "é" * 400,
        ".",
        "",
        "a/b\\c:d*e?f|g",
    ],
)
def test_a_hostile_name_is_a_plain_file_in_its_folder(tmp_path, name):
    stem = file_stem(name)
    path = tmp_path / f"{stem}.png"
    write_frame(path, picture(np.uint8, 3))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert stem.isprintable() and not set(stem) & set("/\\:*?\"'<>|\u202e") and stem[0] not in "-."


def test_names_that_would_be_one_file_are_told_apart():
    stems = distinct_stems(["A b", "a*B", "sheet", "é", "e\u0301", "\u202e", "\u202d"])
    assert len({stem.casefold() for stem in stems}) == 7
    assert "sheet" not in stems
