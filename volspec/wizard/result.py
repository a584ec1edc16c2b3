"""Result of a wizard: the redesigned scene, its figures, and its files.

    Scene, Design -> [result] -> NEW.toml, NEW-palette.toml

The new scene keeps the comments of its file; the palette is next to it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec._files import require_suffix, require_writable
from volspec.appearance import view_transform
from volspec.appearance.models import cielab, delta_E_2000
from volspec.basis import MaterialBasis
from volspec.errors import Code, SceneError, SpectrumError
from volspec.palette import ApartReport, Design, DesignReport, PaletteSpectrum, save_palette
from volspec.relight import Illumination
from volspec.scene import NamedLight, Scene, SceneFile, scene_data, scene_file, write_scene
from volspec.scene.tables import BasisSpec, LightSpec
from volspec.spectra import Spectrum
from volspec.spectra.files import rebase_path, split_address
from volspec.spectra.library import light_terms
from volspec.wizard.scene_palette import ScenePalette

Array = NDArray[np.float64]

# Palette's name in a new scene's addresses until the scene is saved.
_PALETTE = "palette.toml"
# CIEDE2000 between a basis and all bands, above which the basis is too coarse.
_BLUR = 0.5
# The next wizard replaces a palette with this comment; any other is the user's own.
_OURS = "Written by volspec wizard, which replaces it"


@dataclass(frozen=True, slots=True)
class LightEvaluation:
    """Figures of one light, in CIEDE2000 of the displayed colours.

    Parameters
    ----------
    light : str
    apart : {(material, material): ΔE}
        Distances between materials.
    changed : {material: ΔE}
        Changes of the designed materials; under a new light, changes of the other materials from
        the light it is ``like``.
    constancy : {material: ΔE}
        Differences of the designed materials' colours from those under the scene's first light.
    like : str
        Name of the light that a new one resembles; empty for a light of the original scene.
    """

    light: str
    apart: dict[tuple[str, str], float]
    changed: dict[str, float]
    constancy: dict[str, float]
    like: str = ""


@dataclass(frozen=True, slots=True)
class Changes:
    """New rows of a scene's file."""

    materials: tuple[str, ...]  # materials with reflectances from the palette
    light: str | None = None  # a new light, from the palette too
    exact: bool = False  # the scene now casts materials, as its basis would blur the design


@dataclass(frozen=True, slots=True, eq=False)
class Redesigned:
    """Result of a wizard.

    Parameters
    ----------
    scene : Scene
        The scene with the designed spectra.
    design : Design
    materials : tuple of str
        Designed materials.
    evaluations : tuple of LightEvaluation
        Figures of every light, as its frames show them.
    changes : Changes
        New rows of the scene's file.
    """

    scene: Scene
    design: Design
    materials: tuple[str, ...]
    evaluations: tuple[LightEvaluation, ...]
    changes: Changes

    def delta_e(self, light: str, one: str, other: str) -> float:
        """Return CIEDE2000 between two materials under a light, as its frames show them."""
        distances = next(row.apart for row in self.evaluations if row.light == light)
        return distances[(one, other) if (one, other) in distances else (other, one)]

    @property
    def constant(self) -> tuple[str, ...]:
        """Designed materials that should have one colour under all lights."""
        palette = self.design.palette
        cells_of = {
            name: {palette.cells.get((name, light)) for light in palette.names[1]}
            for name in self.materials
        }
        groups = {name: {c.group if c else "" for c in cells} for name, cells in cells_of.items()}
        return tuple(n for n, group in groups.items() if len(group) == 1 and any(group))

    @property
    def apart(self) -> tuple[ApartReport, ...]:
        """Materials that the design was to distinguish, as viewers with deficiencies see them."""
        reports = {
            frozenset(pair.reflectances): pair
            for pair in reversed(DesignReport.of(self.design).apart)
            if set(pair.reflectances) <= set(self.scene.materials)
        }
        return tuple(reversed(reports.values()))

    @property
    def lamps(self) -> dict[str, float]:
        """Share of each lamp in the illuminance of a new light that is a mixture."""
        if self.changes.light is None:
            return {}
        palette = self.design.palette
        light = palette.member("light", self.changes.light)
        names = (lamp.name for lamp in light.mixture)
        return dict(zip(names, light.lamp_shares(palette.grid), strict=True))

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, Path]:
        """Write the scene's file with its comments, and next to it ``…-palette.toml``.

        Returns both paths.

        Raises
        ------
        SceneError
            If the path is the original scene, or a file exists that no wizard wrote.
        InputError
            If the files cannot be written there.
        """
        return _write(self.scene, self.design, self.changes, Path(path))


@dataclass(frozen=True, slots=True, eq=False)
class NewLight:
    """A light that a wizard designs."""

    member: PaletteSpectrum  # free
    like: NamedLight  # the light of the scene that it resembles


def redesign(
    scene: Scene, solution: Design, materials: Sequence[str], light: NewLight | None
) -> Redesigned:
    """Put a design into a scene and evaluate its colours."""
    spectra = {**scene.known, **{f"{_PALETTE}#{n}": solution.reflectance(n) for n in materials}}
    lights, name = list(scene.file.light), None
    if light is not None:
        name = light.member.name
        address = f"{_PALETTE}#{name}"
        spectra[address] = solution.light(name)
        lux = None  # of a room's light: as of the room's file
        if scene.room is None:
            lux = light.like.rig.facing(scene.raycast.shares()).total_lux
        lights.append(LightSpec(name=name, spectrum=address, illuminance_lux=lux))
    changes = Changes(tuple(materials), name)
    file = _with_addresses(replace(scene.file, light=tuple(lights)), changes, _PALETTE)
    after, exact = _with_exact_basis(Scene(file, scene.path, spectra), spectra)
    figures = evaluate_lights(scene, after, materials, light.like if light else None)
    changes = replace(changes, exact=exact)
    return Redesigned(after, solution, tuple(materials), figures, changes)


def _with_addresses(file: SceneFile, changes: Changes, palette: str) -> SceneFile:
    """Return a scene's file with the designed spectra as addresses in a palette."""
    material = [
        replace(row, reflectance=f"{palette}#{row.name}") if row.name in changes.materials else row
        for row in file.material
    ]
    light = [
        replace(row, spectrum=f"{palette}#{row.name}") if row.name == changes.light else row
        for row in file.light
    ]
    return replace(file, material=tuple(material), light=tuple(light))


def _with_exact_basis(scene: Scene, spectra: dict[str, Spectrum]) -> tuple[Scene, bool]:
    """Return the scene, and True if it now casts materials because its basis was too coarse."""
    filters = any(row.filter is not None for row in scene.file.material)
    if filters or isinstance(scene.basis, MaterialBasis):
        return scene, False
    basis = BasisSpec(method="materials", grid_nm=scene.file.basis.grid_nm)
    exact = Scene(replace(scene.file, basis=basis), scene.path, spectra)
    errors = (
        delta_E_2000(displayed_Lab(scene, one), displayed_Lab(exact, other))
        for one, other in zip(scene.lights, exact.lights, strict=True)
    )
    return (scene, False) if max(map(np.max, errors)) < _BLUR else (exact, True)


def evaluate_lights(
    before: Scene, after: Scene, materials: Sequence[str], like: NamedLight | None = None
) -> tuple[LightEvaluation, ...]:
    """Return the figures of every light: the designed materials against each other and the rest.

    ``like`` is the light that a new one resembles.
    """
    old = {light.name: light for light in before.lights}
    names, evaluations = list(after.materials), []
    pairs = [
        (one, two)
        for number, one in enumerate(materials)
        for two in names
        if two not in materials[: number + 1]
    ]
    first: dict[str, Array] = {}
    for light in after.lights:
        Lab = dict(zip(names, displayed_Lab(after, light), strict=True))
        first = first or Lab
        distances = {(one, two): float(delta_E_2000(Lab[one], Lab[two])) for one, two in pairs}
        is_new, changed = light.name not in old, dict[str, float]()
        compared = old.get(light.name, like)
        if compared is not None:
            original = dict(zip(names, displayed_Lab(before, compared), strict=True))
            changed = {
                name: float(delta_E_2000(original[name], Lab[name]))
                for name in names
                if (name in materials) != is_new
            }
        resembled = compared.name if is_new and compared is not None else ""
        constancy = {name: float(delta_E_2000(first[name], Lab[name])) for name in materials}
        evaluations.append(LightEvaluation(light.name, distances, changed, constancy, resembled))
    return tuple(evaluations)


def displayed_Lab(scene: Scene, light: NamedLight) -> Array:
    """Return (K, 3) CIELAB of a scene's materials in its frames, facing every source.

    The scene's own basis, mode, level and viewing apply; colours are clipped to the display.
    """
    groups = scene.raycast.shares()
    spec = replace(scene.relight, viewing=ScenePalette(scene).viewing)
    illumination = Illumination.of(scene.basis, light.rig, spec, groups)
    channels = scene.basis.channels_for_materials(scene.materials)
    layers = np.hstack([fraction * channels for fraction in groups.values()])
    XYZ = illumination.scene_XYZ(layers, np.ones(len(layers)))
    display_XYZ = view_transform(illumination.viewing, illumination.white_XYZ).apply(XYZ)
    space = spec.viewing.display.colours
    RGB = np.clip(display_XYZ @ space.RGB_from_XYZ.T, 0.0, 1.0)
    return cielab(np.linalg.solve(space.RGB_from_XYZ, RGB.T).T, space.white_XYZ)


def require_output(scene: Scene, path: Path) -> Path:
    """Refuse a new scene that would overwrite files not written by a wizard.

    Returns the path of the palette next to the scene.

    Raises
    ------
    SceneError
        If the path is not a ``.toml`` or is the scene itself; if it or its palette is the user's
        own, or the scene uses spectra from that palette.
    InputError
        If the path cannot be written.
    """
    require_suffix(path, "scenes", ".toml", error=SceneError)
    palette = path.with_name(f"{path.stem}-palette.toml")
    for target in (path, palette):
        require_writable(target)

    def refuse(problem: str, code: Code, remedy: str = "give the new scene another name") -> None:
        raise SceneError(problem, remedy, code=code, given=path)

    if _same_file(path, scene.path):
        problem = f"{path}: is the scene that the new one is made from"
        refuse(problem, "conflict")
    if path.exists() and not _uses_palette(path, palette):
        refuse(f"{path}: exists and was not written by a wizard", "duplicate")
    if not palette.exists():
        return palette
    start = palette.read_bytes().removeprefix(b"\xef\xbb\xbf")[:200].decode("utf-8", "replace")
    if not start.lstrip("# ").startswith(_OURS):
        remedy = "rename it, or give the new scene another name"
        refuse(f"{palette}: exists and was not written by a wizard", "duplicate", remedy)
    files = (scene.folder / name for name in _spectrum_files(scene.file, scene.folder))
    if any(_same_file(palette, file) for file in files):
        refuse(f"{palette}: {scene.path} uses spectra from it", "conflict")
    return palette


def _uses_palette(path: Path, palette: Path) -> bool:
    """Return True if a scene uses spectra from the palette next to it, as wizards write it."""
    try:
        file = scene_file(scene_data(path), path)
    except SceneError:
        return False
    return any(path.parent / name == palette for name in _spectrum_files(file, path.parent))


def _spectrum_files(file: SceneFile, folder: Path) -> Iterator[str]:
    """Yield the files from which a scene loads spectra."""
    names = [row.reflectance for row in file.material if isinstance(row.reflectance, str)]
    for row in file.light:
        if isinstance(row.spectrum, str):
            with suppress(SpectrumError):  # a new light is not in a file yet
                names += [name for name, _ in light_terms(row.spectrum, folder)]
    yield from (address[0] for name in names if (address := split_address(name)))


def _same_file(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)


def _write(scene: Scene, solution: Design, changes: Changes, path: Path) -> tuple[Path, Path]:
    palette = require_output(scene, path)
    if not scene.path.is_file():
        problem = f"{scene.path}: cannot be read again; load it from a file"
        raise SceneError(problem, code="not-found")
    # Relative to the original scene's folder, like all file names in the scene.
    address = rebase_path(palette.name, palette.parent, scene.folder)
    file = _with_addresses(scene.file, changes, address)
    # The palette first: a scene without its palette would be broken, but not vice versa.
    save_palette(solution, palette, comment=f"{_OURS}; delete this line to keep it")
    return write_scene(file, path, scene), palette
