"""Write a scene of meshes for Mitsuba 3, with spectra.

    meshes, materials, camera, lights -> [mitsuba_scene] -> NAME.xml, NAME-*/*.ply, *.spd, *.png

A pixel's radiance under Mitsuba's spectral variants is the light's spectrum times the coefficients
of a cast. Spectra on a grid are written as steps, since a band's value is its mean.

References
----------
[1] Jakob et al., Mitsuba 3 renderer, https://mitsuba-renderer.org; scene format 3.0.0.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from volspec._checks import checked_size
from volspec._files import require_suffix, require_writable, write_whole
from volspec.appearance.display.spaces import SPACES, sRGB_CURVE
from volspec.camera import Camera
from volspec.errors import MeshError, SpectrumError, VolspecWarning, nearest
from volspec.export.png import PngWriter
from volspec.mesh.model import Mesh
from volspec.mesh.texture import Texture
from volspec.raycast import Ambient, Directional, Point, RaycastSpec
from volspec.raycast.lights import Headlight, Source
from volspec.relight import LightRig
from volspec.spectra import Spectrum
from volspec.spectra.files.tables import spectrum_text

Array = NDArray[np.float64]
Element = ElementTree.Element
# Half the width of a step between two bands, nm; of wavelengths in float32 the last digit is 6e-5.
_EDGE_NM = 1e-3
_BOUNCES = 3
_FOLDER = re.compile(r'<default name="files" value="([^"/\\]*-[0-9a-f]{8})"')


def save_mitsuba(
    path: str | os.PathLike[str],
    meshes: Sequence[Mesh],
    materials: Mapping[str, Spectrum],
    camera: Camera,
    light: Spectrum | LightRig,
    size: tuple[int, int] = (512, 512),
    spec: RaycastSpec | None = None,
) -> Path:
    """Write meshes, camera and lights as a scene for Mitsuba 3.

    Next to the file is a folder, ``NAME-1a2b3c4d``, with meshes (``.ply``), reflectances and lights
    (``.spd``) and textures (``.png``). The file appears last, so a scene is there as a whole or
    not at all. ``mitsuba -m scalar_spectral -D samples=256 NAME.xml`` renders it.

    Parameters
    ----------
    path : path
        File name that ends in ``.xml``.
    meshes, materials, camera, size, spec
        As for `cast_meshes`.
    light : Spectrum or LightRig
        Spectra of the light groups.

    Returns
    -------
    path

    Raises
    ------
    MeshError
        If there is no mesh, a material is unknown or the file's name has another suffix.
    SpectrumError
        If the light is not on a grid.
    InputError
        If the files cannot be written.

    Warns
    -----
    VolspecWarning
        Of each thing that Mitsuba shows in another way.

    Notes
    -----
    Materials are ``diffuse``, seen from both sides; shares and textures of materials are
    ``blendbsdf``, exact at points and texels, and also between them for two materials. To colours
    of textures Mitsuba gives spectra of its own. Highlights are a ``roughconductor`` of the same
    width and height, opacity is a ``mask``, mirrors are a ``conductor``; gratings are left out.
    Directional and point lights are exact, and all cast shadows; light that has the same strength
    at any distance has it at the middle of the meshes. Ambient light is a ``constant`` emitter,
    which meshes shade at any distance.

    Examples
    --------
    >>> import volspec as vs
    >>> ball = vs.shape_mesh("sphere", 20.0, "copper")
    >>> copper, camera = {"copper": vs.reflectance("copper")}, vs.Camera((0, -60, 20), (0, 0, 0))
    >>> sun = vs.LightGroup("sun", (vs.Directional((1, -1, 1), shadows=True),))
    >>> spec = vs.RaycastSpec(groups=(sun,))
    >>> save_mitsuba("out/ball.xml", [ball], copper, camera, vs.light("A"), (64, 64), spec)
    PosixPath('out/ball.xml')
    """
    target = require_suffix(path, "scenes for Mitsuba", ".xml", error=MeshError)
    require_writable(target)
    if not meshes:
        raise MeshError("no meshes are given", "give one at least", code="missing")
    spec = RaycastSpec() if spec is None else spec
    scene = _Scene(meshes, materials, camera, checked_size(size), spec)
    root = scene.element(LightRig.of(light))
    digest = hashlib.sha256()
    for name, content in scene.files.items():
        digest.update(name.encode() + content)
    folder = target.with_name(f"{target.stem}-{digest.hexdigest()[:8]}")
    defaults = {"files": folder.name, "samples": 64, "pixel_format": "rgb"}
    for row, (name, value) in enumerate(defaults.items()):
        root.insert(row, Element("default", name=name, value=str(value)))
    ElementTree.indent(root)
    _write(target, folder, scene.files, ElementTree.tostring(root, encoding="unicode"))
    return target


def _write(target: Path, folder: Path, files: Mapping[str, bytes], text: str) -> None:
    """Write the folder, then the file, then remove the folder of the file that it replaces."""
    before = ""
    with suppress(OSError, UnicodeDecodeError):
        before = target.read_text(encoding="utf-8")
    there = folder.exists()
    try:
        for name, content in files.items():
            with write_whole(folder / name) as temporary:
                temporary.write_bytes(content)
        with write_whole(target) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
    except BaseException:
        if not there:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    last = _FOLDER.search(before)
    if last and last[1].startswith(f"{target.stem}-") and last[1] != folder.name:
        shutil.rmtree(target.with_name(last[1]), ignore_errors=True)


class _Scene:
    """The elements of a scene, and the files that they name."""

    def __init__(
        self,
        meshes: Sequence[Mesh],
        materials: Mapping[str, Spectrum],
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
    ) -> None:
        self.meshes, self.materials = meshes, materials
        self.camera, self.size, self.spec = camera, size, spec
        self.files: dict[str, bytes] = {}
        self._references: dict[str, str] = {}
        # Of a highlight's weight, whose complement the diffuse part has.
        peak = (spec.shininess + 2) / 8.0
        self._shine = spec.specular / (peak * spec.diffuse) if spec.diffuse else 0.0
        points = np.concatenate([mesh.points_mm for mesh in meshes])
        self._middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self._reach = float(np.linalg.norm(points - camera.position_mm, axis=1).max())

    def element(self, rig: LightRig) -> Element:
        """Return the whole scene."""
        root = Element("scene", version="3.0.0")
        root.append(self._integrator())
        root.append(self._sensor())
        root.extend(self._emitters(rig))
        shapes = [self._shape(number, mesh) for number, mesh in enumerate(self.meshes)]
        for name, reference in self._references.items():
            root.append(_made("bsdf", "diffuse", self._spectrum("reflectance", reference)))
            root[-1].set("id", reference)
            root[-1].insert(0, ElementTree.Comment(f" {name.replace('--', '- -')} "))
        root.extend(shapes)
        return root

    def _integrator(self) -> Element:
        """Return one of direct light; through masks, and into mirrors where there are any."""
        if any(mesh.mirror for mesh in self.meshes):
            _warn("mirrors: Mitsuba follows light between all surfaces, not only to mirrors")
            found = _made("integrator", "volpath", _value("integer", "max_depth", 2 + _BOUNCES))
        elif any(mesh.opacity < 1.0 for mesh in self.meshes):
            found = _made("integrator", "volpath", _value("integer", "max_depth", 2))
        else:
            found = _made("integrator", "direct")
        found.append(_value("boolean", "hide_emitters", "true"))
        return found

    def _sensor(self) -> Element:
        camera, (width, height) = self.camera, self.size
        place = Element("transform", name="to_world")
        if camera.height_mm is None:
            found = _made("sensor", "perspective", _value("float", "fov", camera.fov_deg))
            found.append(_value("string", "fov_axis", "y"))
        else:
            found = _made("sensor", "orthographic")
            # Half the width.
            scale = _text(0.5 * camera.height_mm * width / height)
            place.append(Element("scale", x=scale, y=scale))
        given = {"origin": camera.position_mm, "target": camera.target_mm, "up": camera.up}
        place.append(Element("lookat", {key: _text(*value) for key, value in given.items()}))
        far = 2.0 * self._reach
        found.extend([_value("float", "near_clip", 1e-5 * far), _value("float", "far_clip", far)])
        found.append(place)
        found.append(_made("sampler", "stratified", _value("integer", "sample_count", "$samples")))
        film = _made("film", "hdrfilm", _made("rfilter", "box"))
        for what, value in (("width", width), ("height", height)):
            film.append(_value("integer", what, value))
        film.append(_value("string", "pixel_format", "$pixel_format"))
        film.append(_value("string", "component_format", "float32"))
        found.append(film)
        return found

    def _emitters(self, rig: LightRig) -> Iterator[Element]:
        spec, ambient = self.spec, None
        rig.facing(spec.shares())  # refuses groups that do not exist
        for group in spec.groups:
            own = rig.shining_from(group.name)
            if own is None:
                continue
            mixed = own.mixed(rig.lights[0].grid) * (1.0 + self._shine)
            for source in group.sources:
                if isinstance(source, Ambient):
                    more = mixed * (source.intensity * spec.ambient)
                    ambient = more if ambient is None else ambient + more
                elif source.intensity * spec.diffuse:
                    yield self._directed(source, mixed * (source.intensity * spec.diffuse * np.pi))
        if ambient is not None and ambient.values.any():
            _warn("ambient light: in Mitsuba meshes shade it at any distance")
            name = self._file(ambient, "ambient")
            yield _made("emitter", "constant", self._spectrum("radiance", name))

    def _directed(self, source: Source, facing: Spectrum) -> Element:
        """Return a source; ``facing`` is its irradiance on what faces it."""
        camera = self.camera
        name = f"light-{sum(each.startswith('light-') for each in self.files)}"
        if isinstance(source, Directional | Point) and not source.shadows:
            _warn(f"{source.kind} light: has no shadows, and casts some in Mitsuba")
        if isinstance(source, Headlight) and camera.height_mm is not None:
            towards = -camera.frame()[2]
        elif isinstance(source, Directional):
            towards = camera.to_world(source.towards, source.frame)
        else:
            falloff = source.falloff_mm if isinstance(source, Point) else None
            at = np.asarray(camera.position_mm)
            if isinstance(source, Point):
                at = camera.place_mm(source.position_mm, source.frame)
            if falloff is None:
                falloff = float(np.linalg.norm(at - self._middle))
                _warn(f"{source.kind} light: in Mitsuba it falls off with the squared distance")
            name = self._file(facing * falloff**2, name)
            place = _xyz("point", "position", at)
            return _made("emitter", "point", place, self._spectrum("intensity", name))
        name = self._file(facing, name)
        way = _xyz("vector", "direction", -towards)
        return _made("emitter", "directional", way, self._spectrum("irradiance", name))

    def _shape(self, number: int, mesh: Mesh) -> Element:
        if mesh.grating is not None:
            _warn(f"{mesh.name}: Mitsuba has no gratings, so the mesh has none there")
        # Numbers of points or triangles: Mitsuba calls r, g, b together "color", and NAME_x NAME.
        extra: dict[str, Array] = {}
        kind = "vertex"
        if isinstance(mesh.material, Texture):
            bsdf = self._textured(mesh, mesh.material, number)
        elif isinstance(mesh.material, str):
            bsdf = self._diffuse(mesh, mesh.material)
        elif isinstance(mesh.material, np.ndarray):
            _warn_of_colours(mesh.name)
            kind = _kind(mesh, mesh.material)
            linear = sRGB_CURVE.decode(mesh.material / 65535.0)
            extra = {key: linear[:, k] for k, key in enumerate("rgb")}
            colour = _made("texture", "mesh_attribute", _value("string", "name", f"{kind}_color"))
            colour.set("name", "reflectance")
            bsdf = _made("bsdf", "diffuse", colour)
        else:
            weights = _blend_weights(np.array([*mesh.material.values()]))
            kind = _kind(mesh, weights[0])
            extra = {f"mix{k}_x": weight for k, weight in enumerate(weights)}
            names = [f"{kind}_mix{k}" for k in range(len(weights))]
            bsdf = self._blended(
                mesh,
                [_made("texture", "mesh_attribute", _value("string", "name", n)) for n in names],
            )
        if self._shine:
            weight = self._shine / (1.0 + self._shine)
            shine = _made("bsdf", "roughconductor", _value("string", "material", "none"))
            shine.append(_value("float", "alpha", np.sqrt(2.0 / (self.spec.shininess + 2))))
            bsdf = _made("bsdf", "blendbsdf", _value("float", "weight", weight), bsdf, shine)
        if mesh.mirror:
            mirror = _made("bsdf", "conductor", _value("string", "material", "none"))
            weigh = _value("float", "weight", mesh.mirror)
            bsdf = _made("bsdf", "blendbsdf", weigh, bsdf, mirror)
        bsdf = _made("bsdf", "twosided", bsdf)
        if mesh.opacity < 1.0:
            bsdf = _made("bsdf", "mask", _value("float", "opacity", mesh.opacity), bsdf)
        name = f"{number:02}-{_plain(mesh.name)}.ply"
        self.files[name] = _ply(mesh, extra, kind)
        shape = _made("shape", "ply", _value("string", "filename", f"$files/{name}"))
        flat = "true" if mesh.normals is None else "false"
        shape.append(_value("boolean", "face_normals", flat))
        # Images begin at the upper left corner, texture coordinates at the lower left one.
        shape.append(_value("boolean", "flip_tex_coords", "true"))
        shape.append(bsdf)
        return shape

    def _textured(self, mesh: Mesh, texture: Texture, number: int) -> Element:
        texels = texture.texels
        height, width = texels.shape[:2]
        name = f"{number:02}-{_plain(texture.name)}"
        if not texture.materials:
            _warn_of_colours(texture.name)
            file = io.BytesIO()
            png = PngWriter(file, (width, height), 3, 16, SPACES["sRGB"], {})
            png.rows(texels)
            png.close()
            self.files[f"{name}.png"] = file.getvalue()
            return _made("bsdf", "diffuse", _bitmap("reflectance", f"{name}.png"))
        if texels.ndim == 2:
            texels = np.arange(len(texture.materials)) == texels[..., None]
        maps = []
        for k, weight in enumerate(_blend_weights(np.moveaxis(texels.astype(np.float64), 2, 0))):
            file = io.BytesIO()
            Image.fromarray(np.rint(65535.0 * weight).astype(np.uint16)).save(file, "png")
            self.files[f"{name}-{k}.png"] = file.getvalue()
            maps.append(_bitmap("weight", f"{name}-{k}.png"))
            maps[-1].append(_value("boolean", "raw", "true"))
        return self._blended(mesh, maps)

    def _blended(self, mesh: Mesh, weights: Sequence[Element]) -> Element:
        """Return the mesh's materials, each laid over those before it by its weight."""
        first, *others = mesh.materials
        bsdf = self._diffuse(mesh, first)
        for name, weight in zip(others, weights, strict=True):
            weight.set("name", "weight")
            bsdf = _made("bsdf", "blendbsdf", weight, bsdf, self._diffuse(mesh, name))
        return bsdf

    def _diffuse(self, mesh: Mesh, name: str) -> Element:
        """Return a reference to a material's BSDF."""
        if name not in self.materials:
            raise MeshError(
                f"{mesh.name}: no material is named {name!r}",
                f"{nearest(name, self.materials)}there is {', '.join(self.materials) or 'none'}",
                code="unknown",
            )
        if name not in self._references:
            stem = f"material-{len(self._references)}-{_plain(name)}"
            if self.materials[name].fluorescence:
                _warn(f"material {name!r}: Mitsuba shows what it reflects, not what it emits")
            self._references[name] = self._file(self.materials[name], stem)
        return Element("ref", id=self._references[name])

    def _file(self, spectrum: Spectrum, stem: str) -> str:
        self.files[f"{stem}.spd"] = spectrum_text(_steps(spectrum), ".spd").encode()
        return stem

    def _spectrum(self, what: str, stem: str) -> Element:
        return Element("spectrum", name=what, filename=f"$files/{stem}.spd")


def _blend_weights(shares: Array) -> list[Array]:
    """Return the weight of each of K materials but the first over those before it."""
    below = np.cumsum(shares, axis=0)
    return [
        np.divide(share, total, out=np.zeros_like(share), where=total > 0.0)
        for share, total in zip(shares[1:], below[1:], strict=True)
    ]


def _steps(spectrum: Spectrum) -> Spectrum:
    """Return the bands of a spectrum as steps; other spectra unchanged."""
    try:
        half = 0.5 * spectrum.grid.step_nm - _EDGE_NM
    except SpectrumError:
        return spectrum
    ends = spectrum.wavelengths_nm[:, None] + [-half, half]
    return Spectrum(ends.ravel(), np.repeat(spectrum.values, 2), spectrum.name, spectrum.notes)


def _kind(mesh: Mesh, values: Array) -> str:
    """Return what values are of, points or triangles."""
    return "vertex" if len(values) == len(mesh.points_mm) else "face"


def _ply(mesh: Mesh, extra: Mapping[str, Array], kind: str) -> bytes:
    """Return a binary PLY, with ``extra`` numbers of points or triangles."""
    columns = {"x": 0, "y": 1, "z": 2}
    points: dict[str, ArrayLike] = {key: mesh.points_mm[:, k] for key, k in columns.items()}
    if mesh.normals is not None:
        points |= {f"n{key}": mesh.normals[:, k] for key, k in columns.items()}
    if mesh.uv is not None:
        points |= {"u": mesh.uv[:, 0], "v": mesh.uv[:, 1]}
    points |= extra if kind == "vertex" else {}
    of_faces = {} if kind == "vertex" else extra
    vertex = np.zeros(len(mesh.points_mm), [(key, "<f4") for key in points])
    for key, values in points.items():
        vertex[key] = values
    layout = [("count", "u1"), ("index", "<i4", 3), *((key, "<f4") for key in of_faces)]
    face = np.zeros(len(mesh.triangles), layout)
    face["count"], face["index"] = 3, mesh.triangles
    for key, values in of_faces.items():
        face[key] = values
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    lines += [f"property float {key}" for key in points]
    lines += [f"element face {len(face)}", "property list uchar int vertex_indices"]
    lines += [f"property float {key}" for key in of_faces]
    head = "\n".join([*lines, "end_header", ""])
    return head.encode("ascii") + vertex.tobytes() + face.tobytes()


def _warn_of_colours(name: str) -> None:
    _warn(f"{name}: Mitsuba gives its colours spectra of its own")


def _warn(text: str) -> None:
    warnings.warn(text, VolspecWarning, stacklevel=2)


def _plain(name: str) -> str:
    """Return a name that any file system and Mitsuba's ids take."""
    return re.sub(r"[^A-Za-z0-9]+", "-", Path(name).stem).strip("-")[:32] or "mesh"


def _text(*numbers: float) -> str:
    return ", ".join(f"{number:.10g}" for number in numbers)


def _made(tag: str, kind: str, *parts: Element) -> Element:
    found = Element(tag, type=kind)
    found.extend(parts)
    return found


def _value(tag: str, name: str, value: float | str) -> Element:
    return Element(tag, name=name, value=value if isinstance(value, str) else _text(value))


def _xyz(tag: str, name: str, vector: Array) -> Element:
    x, y, z = (_text(number) for number in vector)
    return Element(tag, name=name, x=x, y=y, z=z)


def _bitmap(name: str, file: str) -> Element:
    found = _made("texture", "bitmap", _value("string", "filename", f"$files/{file}"))
    found.set("name", name)
    return found
