"""Readers under fuzzing: the project's own, as a table of name, seeds and function.

    valid files -> [fuzz_targets] -> fuzz, tests/fuzz/test_fuzz.py

Readers of other libraries are rows of the same table, `TARGETS`. Files that they read in addition
to the mutated file (the other slices of a folder, the chunks of a store) are `Target.companions`.
"""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz_target import Target
from benchmarks.fuzz_volumes import volumes
from volspec.errors import VolspecError

ROOT = Path(__file__).resolve().parents[1]
_PIXELS = 4  # width and height of a seed picture
_GROUPS = {"key": 0.7, "sky": 0.3}
_TEXTS = ("basis", "groups", "notes", "fov_deg", "compositing", "viewing")


def _files(*patterns: str) -> Callable[[], Iterable[bytes]]:
    return lambda: [path.read_bytes() for each in patterns for path in sorted(ROOT.glob(each))]


def _written(write: Callable[[Path], object], name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path)
        return path.read_bytes()


def _ball() -> bytes:
    from volspec.volume import phantom

    return _written(lambda path: np.save(path, phantom.ball(6).values), "ball.npy")


def _spectral_images() -> Iterable[bytes]:
    from volspec.spectra import SpectralImage

    nm = np.linspace(400.0, 700.0, 4)
    values = np.linspace(0.0, 1.0, _PIXELS * _PIXELS * nm.size)
    for kind in ("reflective", "emissive"):
        image = SpectralImage(values.reshape(_PIXELS, _PIXELS, -1), nm, kind, {"camera": "x"})
        stored = _written(image.save, "i.exr")
        yield from (stored, _uncompressed(stored))


def _uncompressed(stored: bytes) -> bytes:
    """Return the same picture uncompressed, so that mutations reach its pixels."""
    import OpenEXR

    header, channels = _parts(stored)
    return _written(lambda path: OpenEXR.File(header, channels).write(str(path)), "i.exr")


def _parts(stored: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header and channels of a picture, to be written without compression."""
    import OpenEXR

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "i.exr")
        path.write_bytes(stored)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            header = {**file.header(), "compression": OpenEXR.NO_COMPRESSION}
            channels = {name: np.array(each.pixels) for name, each in file.channels().items()}
    header.pop("channels")
    return header, channels


@cache
def _image() -> Any:
    from volspec.basis import SpectralBasis
    from volspec.image import CoefficientImage

    basis = SpectralBasis.load("general-5")
    shape = _PIXELS, _PIXELS, len(_GROUPS) * basis.size
    coefficients = np.linspace(0.0, 0.5, int(np.prod(shape)), dtype=np.float32).reshape(shape)
    alpha = np.full(shape[:2], 0.5, np.float32)
    return CoefficientImage(
        *(coefficients, alpha, alpha, basis, {"viewing": '{"backdrop": 0.25}'}),
        groups=_GROUPS,
        first_mm=alpha,
        fov_deg=30.0,
    )


def _recipe() -> Any:
    from volspec.export.compositing import Recipe
    from volspec.spectra import light

    return Recipe.of(_image().basis, _GROUPS, {"day": light("D65"), "lamp": light("A")})


def _images() -> Iterable[bytes]:
    from volspec.export.compositing import save_for_compositors

    stored = _written(lambda path: save_for_compositors(_image(), path, _recipe()), "i.exr")
    return stored, _uncompressed(stored)


def _image_texts() -> Iterable[bytes]:
    image = _image()
    values = (image.basis.to_dict(), image.groups, dict(image.notes), 30.0)
    texts = [json.dumps(value) for value in values]
    texts += [_recipe().texts()["compositing"], '{"backdrop": 0.25, "model": "CAM16"}']
    return [f"{key}\n{text}".encode() for key, text in zip(_TEXTS, texts, strict=True)]


def _read_image(path: Path) -> None:
    """Load an image, and make the scripts for other programs."""
    from volspec.export.compositing import Recipe
    from volspec.export.recipes import blender_script, nuke_group
    from volspec.image import CoefficientImage
    from volspec.scene import stored_relight_spec

    stored_relight_spec(CoefficientImage.load(path))
    nuke_group(Recipe.load(path), path)
    blender_script(path)


def _read_image_text(path: Path) -> None:
    """Read an image whose header holds the file's text: the first line is its name."""
    import OpenEXR

    data, exr = path.read_bytes(), path.with_suffix(".exr")
    key, _, text = data.decode("utf-8", "replace").partition("\n")
    key = key if key in _TEXTS else _TEXTS[len(data) % len(_TEXTS)]
    if key == "viewing":
        key, text = "notes", json.dumps({"viewing": text})
    header, channels = _image_parts()
    try:
        OpenEXR.File({**header, f"volspec:{key}": text}, dict(channels)).write(str(exr))
    except (RuntimeError, ValueError):  # a text that OpenEXR refuses
        return
    _read_image(exr)


@cache
def _image_parts() -> tuple[dict[str, Any], dict[str, Any]]:
    return _parts(next(iter(_images())))


def _read_spectrum(path: Path) -> None:
    from volspec.spectra.files.reading import read_spectrum

    read_spectrum(path)


def _read_beam(path: Path) -> None:
    from volspec.room.beam import read_beam

    read_beam(path).relative(np.eye(3))


def _read_spectral_image(path: Path) -> None:
    from volspec.spectra import SpectralImage

    SpectralImage.load(path)


_LABEL_TABLES = (
    b"0 Clear 0 0 0 0\n1 liver 220 30 20 255\n2 left_kidney 10 200 20 255\n",
    b'1 255 0 0 1 1 1 "liver"\n2 0 255 0 0.5 0 0 "kidney"\n',
    b"index,name,color\n1,liver,#ff0000\n2,kidney,#00ff00\n",
    b'{"1": "liver", "2": "kidney"}',
    b"1|liver|3\n2|kidney|4\n",
    bytes(768),
)


def _read_label_table(path: Path) -> None:
    from volspec.volume.files.label_tables import labels_in_xml, read_label_table

    labels_in_xml(path.read_bytes().decode("utf-8", "replace"))
    read_label_table(path)


def _read_table(path: Path) -> None:
    from volspec.spectra.files.tables import read_table

    table = read_table(path)
    for name in table.names[:4]:
        table.spectrum(name)


def _read_triples(path: Path) -> None:
    from volspec.cli.arguments import read_triples

    read_triples((), path, ("X", "Y", "Z"))


def _read_profile(path: Path) -> None:
    from volspec.appearance.display.profile import read_profile

    read_profile(path)


def _profiles() -> Iterable[bytes]:
    from PIL import ImageCms

    yield ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def _read_scene(path: Path) -> None:
    """Read and resolve a scene, without training a basis, which takes seconds."""
    from volspec.scene import Scene
    from volspec.scene.file import scene_data, scene_file
    from volspec.scene.tables.specs import BasisSpec

    file = scene_file(scene_data(path), path)
    scene = Scene(replace(file, basis=BasisSpec(name="general-5")), path)
    scene.camera(scene.volume())


def _scenes() -> Iterable[bytes]:
    """Yield the shipped scenes with the small ball, except those that train a basis for seconds."""
    for path in sorted((ROOT / "data/scenes").glob("*.toml")):
        text = path.read_text(encoding="utf-8")
        lines = (
            'file = "ball.npy"' if line.startswith("file = ") else line
            for line in text.splitlines()
        )
        if "train" not in text:
            yield "\n".join(lines).encode()


def _read_palette(path: Path) -> None:
    from volspec.errors import SpectrumError
    from volspec.palette import load_palette
    from volspec.spectra.files.reading import read_spectrum

    with suppress(SpectrumError):
        read_spectrum(f"{path}#1")
    load_palette(path)


def _rewrite_palette(path: Path) -> None:
    """Write a palette into its own text, which tomlkit parses."""
    from volspec.palette import load_palette, save_palette

    save_palette(load_palette(path), path.with_name("saved.toml"), path)


def _read_session(path: Path) -> None:
    from volspec.viewer.work.session import read_session, restore_state

    restore_state(read_session(path), cast=False)


def _session_parts() -> dict[str, bytes]:
    return {"ball.toml": b'[volume]\nfile = "ball.npy"\n', "ball.npy": _ball()}


def _read_kept(path: Path) -> None:
    """Read files from the user's folders; damaged files are ignored."""
    from volspec.export.manifest import ExportFolder
    from volspec.viewer.work.session_store import RecentFiles

    data = path.read_bytes()
    for name in ("recent.json", "export.json"):
        path.with_name(name).write_bytes(data)
    RecentFiles(path.parent).rows()
    folder = ExportFolder(path.parent, "fingerprint", ("a.png", "b.png"))
    folder.missing()
    folder.begin(overwrite=True)


def _kept() -> Iterable[bytes]:
    yield json.dumps(["/a.toml", "/b.nrrd?key=1"]).encode()
    sizes = {"fingerprint": "fingerprint", "files": ["a.png", "b.png"], "sizes": {"a.png": 3}}
    yield json.dumps(sizes).encode()
    yield json.dumps({**sizes, "fingerprint": "other"}).encode()


def _read_cache(path: Path) -> None:
    from volspec import _cache

    _cache._read(path, "maker")


def _caches() -> Iterable[bytes]:
    for save in (np.savez, np.savez_compressed):
        buffer = io.BytesIO()
        save(buffer, maker="maker", keys=["a", "b"], a=np.arange(9.0), b=np.zeros((2, 3), "f4"))
        yield buffer.getvalue()


def _read_basis(path: Path) -> None:
    from volspec.basis import load_basis

    load_basis(path)


def _read_words(path: Path) -> None:
    """Read option values, one per line."""
    from volspec.cli.arguments import read_setting
    from volspec.palette.model import parse_colour
    from volspec.spectra import DEFAULT_GRID, reflectance

    for word in path.read_bytes().decode("utf-8", "surrogateescape").split("\n")[:4]:
        for read in (
            lambda text: read_setting(text, _GROUPS, DEFAULT_GRID),
            reflectance,
            parse_colour,
        ):
            try:
                read(word)
            except VolspecError:
                continue


def _read_picture(path: Path) -> None:
    from volspec.cli.reflectance import _pixels

    _pixels(path)


def _pictures() -> Iterable[bytes]:
    from PIL import Image

    picture = Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    for kind in ("PNG", "JPEG", "TIFF"):
        buffer = io.BytesIO()
        picture.save(buffer, kind)
        yield buffer.getvalue()


def _pixels_declared(data: bytes) -> int:
    """Return 4 bytes per pixel that Pillow's own guard permits, as pictures may be compressed."""
    return 4 * 89_478_485


def _tm27() -> Iterable[bytes]:
    samples = "".join(
        f'<SpectralData wavelength="{w}">0.5</SpectralData>' for w in range(380, 781, 40)
    )
    yield (
        '<?xml version="1.0"?><IESTM2714 xmlns="http://www.ies.org/iestm2714" version="1.0">'
        "<Header><Manufacturer>Lamps</Manufacturer><CatalogNumber/><Description>Street lamp"
        "</Description></Header><SpectralDistribution><SpectralQuantity>relative"
        "</SpectralQuantity><BandwidthFWHM>1.0</BandwidthFWHM><BandwidthCorrected>true"
        f"</BandwidthCorrected>{samples}</SpectralDistribution></IESTM2714>"
    ).encode()


def _charts() -> Iterable[bytes]:
    spectral = " ".join(f"SPEC_{nm}" for nm in range(380, 781, 40))
    for start, values in (("CGATS.17", "0.5 "), ("CTI3", "50 ")):
        yield (
            f'{start}\n\nORIGINATOR "Lamps"\nSPECTRAL_BANDS "11"\nSPECTRAL_START_NM "380.0"\n'
            'SPECTRAL_END_NM "780.0"\nSPECTRAL_NORM "100.0"\nNUMBER_OF_FIELDS 13\n'
            f"BEGIN_DATA_FORMAT\nSAMPLE_ID SAMPLE_NAME {spectral}\nEND_DATA_FORMAT\n"
            f'NUMBER_OF_SETS 1\nBEGIN_DATA\nA1 "dark skin" {values * 11}\nEND_DATA\n'
        ).encode()


def _cxf() -> Iterable[bytes]:
    yield (
        b'<?xml version="1.0"?><CxF xmlns="http://colorexchangeformat.com/CxF3-core"><Resources>'
        b'<ObjectCollection><Object Name="Cyan" Id="c1"><ColorValues><ReflectanceSpectrum '
        b'ColorSpecification="M1" StartWL="400">0.1 0.2 0.3</ReflectanceSpectrum></ColorValues>'
        b'</Object></ObjectCollection><ColorSpecificationCollection><ColorSpecification Id="M1">'
        b'<MeasurementSpec><WavelengthRange StartWL="400" Increment="150"/></MeasurementSpec>'
        b"</ColorSpecification></ColorSpecificationCollection></Resources></CxF>"
    )


def _envi() -> Iterable[bytes]:
    for interleave in ("bsq", "bip"):
        yield (
            "ENVI\ndescription = {a wall}\nsamples = 4\nlines = 2\nbands = 3\nheader offset = 0\n"
            f"data type = 4\ninterleave = {interleave}\nbyte order = 0\nbbl = {{1, 1, 1}}\n"
            "wavelength units = Nanometers\nwavelength = {390, 550, 710}\n"
            "reflectance scale factor = 2\ndata ignore value = -1\n"
        ).encode()
    yield (
        b"ENVI\nfile type = ENVI Spectral Library\nsamples = 3\nlines = 1\nbands = 1\n"
        b"data type = 2\nspectra names = {grass}\nwavelength = {0.39, 0.55, 0.71}\n"
    )


def _ies() -> Iterable[bytes]:
    for planes in ("0", "0 45 90"):
        count = len(planes.split())
        yield (
            f"IESNA:LM-63-1995\n[TEST] 1\nTILT=NONE\n1 1000 1 3 {count} 1 2 0 0 0\n1 1 20\n"
            f"0 45 90\n{planes}\n" + "300 200 100\n" * count
        ).encode()


def _ldt() -> Iterable[bytes]:
    for symmetry, rows in (1, 1), (3, 3), (4, 2):
        head = ["Lamps", "1", str(symmetry), "4", "90", "3", "45", *["0"] * 16, "1", "0", "1"]
        numbers = ["0", "90", "180", "270", "0", "45", "90", *["300", "200", "100"] * rows]
        lamp = ["1", "LED", "1000", "3000", "80", "20"]
        yield "\n".join([*head, *lamp, *["0.5"] * 10, *numbers]).encode()


def _scene_parts() -> dict[str, bytes]:
    """Return the ball and the spectra that shipped scenes name."""
    tables = {f"spectra/{path.name}": path for path in (ROOT / "data/spectra").glob("e*.csv")}
    palettes = {f"palettes/{path.name}": path for path in (ROOT / "data/palettes").iterdir()}
    parts = {name: path.read_bytes() for name, path in (tables | palettes).items()}
    return {"scenes/ball.npy": _ball(), **parts}


_TOML = (b"[[light]]\n", b"[[material]]\n", b"[[", b"]]\n", b"{ ", b"= 1e999\n", b'"""', b"inf")
_JSON = (b"null", b"NaN", b"Infinity", b"1e999", b"[]", b"{}", b'{"a":', b"-0.0", b"\\ud800")
_EXR = (b"string\0", b"box2i\0", b"chlist\0", b"float\0", b"volspec:notes\0", b"tiledesc\0")
_WORDS = (
    *(b"D65*0.7+A*0.3", b"key=A; sky=D65*0.3", b"planck:3000", b"daylight:6500", b"FL2", b"E*2"),
    *(b"grey:0.5", b"copper", b"#ca0020", b"steelblue", b"[0.1, 0.2, 0.3]", b"gauss:550,20"),
)

TARGETS: Mapping[str, Target] = {
    "csv": Target(
        _read_table,
        _files("data/spectra/[em]*.csv"),
        "input.csv",
        tokens=(b",", b";", b"\t", b"# unit: nm\n", b"nan", b'"', b"1e999", b"\x85"),
    ),
    "triples": Target(
        _read_triples, lambda: [b"X,Y,Z\n1,2,3\n4,5,6\n", b"19.01,20,21.78\n"], "input.csv"
    ),
    "tm27": Target(
        _read_spectrum,
        _tm27,
        "input.spdx",
        tokens=(
            b"<!ENTITY a 'b'>",
            b"&a;",
            b"<!DOCTYPE IESTM2714 [",
            b"]>",
            b"<![CDATA[",
            b'<SpectralData wavelength="500">1</SpectralData>',
        ),
    ),
    "cgats": Target(
        _read_spectrum,
        _charts,
        "input.ti3",
        tokens=(
            *(b"BEGIN_DATA\n", b"END_DATA\n", b"BEGIN_DATA_FORMAT\n", b"NUMBER_OF_SETS 9\n"),
            *(
                b"SPECTRAL_NM ",
                b"SPECTRAL_PCT ",
                b"SPECTRAL_BANDS 1e9\n",
                b'"',
                b",",
                b"\t",
                b"nan",
            ),
        ),
    ),
    "cxf": Target(
        _read_spectrum,
        _cxf,
        "input.cxf",
        tokens=(b"<!DOCTYPE CxF [", b"&a;", b'Increment="1e308"', b'EndWL="1"', b"nan", b"1e999"),
    ),
    "envi": Target(
        _read_spectrum,
        _envi,
        "input.hdr",
        lambda: {"input.img": np.linspace(0.0, 1.0, 24, dtype=np.float32).tobytes()},
        tokens=(
            *(b"bands = 9\n", b"lines = 999999999999\n", b"data type = 12\n", b"{", b"}", b"nan"),
            *(b"interleave = bil\n", b"file type = ENVI Spectral Library\n", b"1e999", b"\xb5"),
        ),
    ),
    "ies": Target(
        *(_read_beam, _ies, "input.ies"),
        tokens=(b"TILT=NONE\n", b"TILT=INCLUDE\n", b"0 180 360\n", b"999999 ", b"1e308 ", b"-1 "),
    ),
    "ldt": Target(
        *(_read_beam, _ldt, "input.ldt"), tokens=(b"0\n", b"4\n", b"0,5\n", b"1e308\n", b"-1\n")
    ),
    "spectral-exr": Target(
        _read_spectral_image, _spectral_images, "input.exr", tokens=_EXR, most=1 << 15
    ),
    "icc": Target(
        _read_profile, _profiles, "input.icc", tokens=(b"curv", b"para", b"XYZ ", b"chad")
    ),
    "scene": Target(_read_scene, _scenes, "scenes/input.toml", _scene_parts, tokens=_TOML),
    "palette": Target(_read_palette, _files("data/palettes/*.toml"), "input.toml", tokens=_TOML),
    "palette-text": Target(
        _rewrite_palette, _files("data/palettes/figure-1.toml"), "input.toml", tokens=_TOML
    ),
    "session": Target(
        _read_session,
        _files("tests/viewer/sessions/*.json"),
        "input.volspec.json",
        _session_parts,
        tokens=_JSON,
        most=1 << 15,
    ),
    "basis": Target(_read_basis, _files("data/bases/general-5*.json"), "input.json", tokens=_JSON),
    "image-exr": Target(_read_image, _images, "input.exr", tokens=_EXR, most=1 << 15),
    "image-texts": Target(_read_image_text, _image_texts, "input.txt", tokens=_JSON),
    "picture": Target(_read_picture, _pictures, "input.png", declared=_pixels_declared),
    "cache": Target(
        _read_cache, _caches, "input.npz", tokens=(b"PK\x03\x04", b"\x93NUMPY", b"'|O'")
    ),
    "kept": Target(_read_kept, _kept, "input", tokens=_JSON),
    "label-table": Target(
        _read_label_table,
        lambda: _LABEL_TABLES,
        "labels.txt",
        tokens=(b"\t", b",", b"{", b'":', b"#", b"<Label", b"1e999", b"\xff\xfe"),
    ),
    "words": Target(
        _read_words,
        lambda: [b"\n".join(_WORDS[at : at + 4]) for at in (0, 4, 8)],
        "words.txt",
        tokens=_WORDS,
        most=400,
    ),
    **volumes(),
}
"""Every reader by name."""
