"""Scenes of others: nothing outside of a folder is read, whatever names it."""

import json
import os
from pathlib import Path

import nibabel
import numpy as np
import pytest
import pyvista
import tifffile
from PIL import Image

import volspec as vs
from tests.scene.test_room import ROOM
from tests.support.commands import call
from tests.support.errors import raises
from tests.support.fixtures import slow
from tests.support.gltf import write_glb
from volspec._files import write_whole
from volspec.appearance.display.spaces import SPACES
from volspec.errors import InputError
from volspec.export.png import icc_profile

SCENE = """version = 2
basis = { name = "BASIS" }
volume = { file = "VOLUME" }
viewing = { filter = "FILTER", display = { space = "ICC" } }
transfer = { points = [{ value = 0.5, opacity = 0.1, material = "a" }] }
material = [{ name = "a", reflectance = "PAINT", filter = "DYE" }]
light = [{ name = "b", spectrum = "LAMP" }]
MORE
"""
PLAIN = {"BASIS": "general-5", "VOLUME": "v.npy", "ICC": "sRGB", "PAINT": "copper", "LAMP": "A"}
PLAIN |= {"FILTER": "grey:0.5", "DYE": "grey:0.5", "MORE": ""}
ROWS = {
    "[[field]]": 'name = "f"\nfile = "@/v.npy"',
    "[[mesh]]": 'material = "a"\nfile = "@/m.vtp"',
    "[[mesh]] ": 'materials = ["a"]\nfile = "m.vtp"\ntexture = "@/t.png"',
    "[[mesh]]  ": 'file = "m.vtp"\nshares.a = "@/g.png"',
    "[room]": 'position_m = [1, 1, 1]\nfile = "@/room.toml"',
    "[room] ": 'position_m = [1, 1, 1]\nfile = "room.toml"\npaint.walls = "@/s.csv"',
}
# Words of a scene that name a file in the folder @.
NAMED = [{key: "@/s.csv"} for key in ("FILTER", "PAINT", "DYE", "LAMP")]
NAMED += [{"VOLUME": name} for name in ("@/v.npy", "v.npy?labels=@/v.txt", "@/v*.npy")]
NAMED += [{"BASIS": "@/b.json"}, {"ICC": "@/x.icc"}]
NAMED += [{"LAMP": "A*0.5+@/s.csv*0.5"}, {"PAINT": "@/p.toml#r"}]
NAMED += [
    {"MORE": f"{key}\n{row}", "LAMP": "room" if "m]" in key else "A"} for key, row in ROWS.items()
]
SHAPE = (9, 9, 9)
VALUES = (np.arange(9**3) % 3).astype(np.uint8).reshape(SHAPE)


def write_files(folder: Path) -> None:
    folder.mkdir()
    np.save(folder / "v.npy", VALUES)
    (folder / "v.txt").write_text("1 liver\n")
    (folder / "s.csv").write_text("".join(f"{nm},0.5\n" for nm in range(360, 840, 10)))
    surface = pyvista.Sphere()
    surface.active_texture_coordinates = np.zeros((surface.n_points, 2))
    surface.save(folder / "m.vtp")
    for name, grey in (("t", 0), ("g", 99)):
        Image.new("L", (4, 4), grey).save(folder / f"{name}.png")
    (folder / "x.icc").write_bytes(icc_profile(SPACES["sRGB"]))
    vs.SpectralBasis.load("general-5").save(folder / "b.json")
    (folder / "room.toml").write_text(ROOM.format(walls="grey:0.5", lamp="A"))
    (folder / "p.toml").write_text('[[reflectance]]\nname = "r"\nspectrum = "copper"\n')


@pytest.fixture(scope="module")
def inside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder, with a link to another one of the same files."""
    top = tmp_path_factory.mktemp("confined")
    for name in ("inside", "outside"):
        write_files(top / name)
    (top / "inside" / "link").symlink_to(top / "outside")
    return top / "inside"


@pytest.mark.filterwarnings("ignore::volspec.errors.VolspecWarning")
@pytest.mark.parametrize("named", NAMED, ids=lambda named: " ".join(named.values()).split("\n")[0])
@pytest.mark.parametrize("place", ["../outside", slow("link"), slow("/"), slow(".")])
def test_whatever_a_scene_names_is_below_the_folder(inside, named, place, capsys):
    folder, text = str(inside.parent / "outside") if place == "/" else place, SCENE
    for key, word in (PLAIN | named).items():
        text = text.replace(key, word.replace("@", folder))
    (inside / "scene.toml").write_text(text)
    found = call("--confined", inside, "scene", "check", inside / "scene.toml")
    assert ("leads outside of" in capsys.readouterr().out) == bool(found) == (place != ".")


MHD = "NDims = 3\nDimSize = 9 9 9\nElementType = MET_UCHAR\nElementDataFile = x.raw\n"
ENVI = "ENVI\nsamples = 1\nlines = 1\nbands = 2\ndata type = 1\ninterleave = bsq\nbyte order = 0\n"
ENVI += "wavelength = { 380, 780 }\n"
BDV = """<SpimData><BasePath>../outside</BasePath><SequenceDescription>
<ImageLoader format="bdv.hdf5"><hdf5>x.h5</hdf5></ImageLoader></SequenceDescription></SpimData>"""
OME = """<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">
<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="9" SizeY="9" SizeZ="18" SizeC="1"
SizeT="1"><TiffData FirstZ="9"><UUID FileName="../outside/x.tif">urn:uuid:1</UUID></TiffData>
</Pixels></Image></OME>"""
LINKED = ("pair.img", "slices/5.png", "a.zarr/c/0/0/0", "x.raw", "beside.txt", "envi.img")
PARTS = ("a.mhd", "pair.hdr", "slices", "a.zarr", "beside.npy", "a.tif", "0.h5", "1.h5", "2.h5")


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files that have a part in another one."""
    h5py, zarr, top = *map(pytest.importorskip, ("h5py", "zarr")), tmp_path_factory.mktemp("parts")
    inside, outside = top / "inside", top / "outside"
    (inside / "slices").mkdir(parents=True)
    outside.mkdir()
    texts = {"a.mhd": MHD, "envi.hdr": ENVI, "a.xml": BDV, "beside.txt": "1 liver\n"}
    for name, text in texts.items():
        (inside / name).write_text(text)
    nibabel.save(nibabel.Nifti1Pair(VALUES.astype("i2"), np.eye(4)), inside / "pair.img")
    for k, values in enumerate(VALUES):
        Image.fromarray(values).save(inside / "slices" / f"{k}.png")
    zarr.create_array(str(inside / "a.zarr"), shape=SHAPE, chunks=SHAPE, dtype="u1")[:] = VALUES
    np.save(inside / "beside.npy", VALUES)
    tifffile.imwrite(inside / "a.tif", VALUES, description=OME, metadata=None)
    for name in ("x.raw", "envi.img"):
        VALUES.tofile(inside / name)
    for name in LINKED:
        os.replace(inside / name, outside / Path(name).name)
        (inside / name).symlink_to(outside / Path(name).name)
    layout = h5py.VirtualLayout(SHAPE, "u1")
    layout[:] = h5py.VirtualSource("../outside/x.h5", "v", SHAPE)
    with (
        h5py.File(outside / "x.h5", "w") as file,
        h5py.File(inside / "0.h5", "w") as linked,
        h5py.File(inside / "1.h5", "w") as virtual,
        h5py.File(inside / "2.h5", "w") as raw,
    ):
        file["v"] = VALUES
        linked["group/v"] = h5py.ExternalLink("../outside/x.h5", "v")
        virtual.create_virtual_dataset("v", layout)
        raw.create_dataset("v", SHAPE, "u1", external=[(str(outside / "x.raw"), 0, VALUES.size)])
    write_glb(inside / "a.glb", 5.0)
    tree = json.loads((inside / "a.glb").read_bytes()[20:].partition(b"BIN\0")[0][:-4])
    tree["buffers"][0]["uri"] = "%2e%2e/outside/a.bin"
    (inside / "a.gltf").write_text(json.dumps(tree))
    return inside


@pytest.mark.parametrize(
    "name", [*PARTS, "a.xml", "a.gltf", "envi.hdr", "https://localhost/a.zarr"]
)
def test_parts_of_a_file_are_below_the_folder(parts, name):
    path = name if "://" in name else str(parts / name)
    with vs.confined(parts), raises(InputError, "unreadable"):
        if name == "a.gltf":
            vs.Mesh.load(path, "copper")
        vs.reflectance(path) if name == "envi.hdr" else vs.load_volume(path)


def test_outputs_and_inner_folders_are_not_led_elsewhere(inside, tmp_path):
    (inside / "inner").mkdir()
    with vs.confined(inside):
        with write_whole(tmp_path / "elsewhere.txt") as temporary:
            temporary.write_text("")
        with raises(InputError, "unwritable"), write_whole(inside / "link" / "x.txt"):
            pass
        with raises(InputError, "unreadable"), vs.confined(inside.parent):
            pass
        with vs.confined(inside / "inner"), raises(InputError, "unreadable"):
            vs.load_volume(inside / "m.vtp")
        assert vs.load_volume("engine") and vs.load_volume("frog"), "these ship"
        assert call("info", inside / "v.npy") == 0
    assert call("info", inside / "link" / "v.npy") == 0
