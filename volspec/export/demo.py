"""Demo: cast a scene once, relight it under its lights, and report times and errors.

A user's script would use the same pipeline: `Scene`, `Relighter`, frames.
"""

from __future__ import annotations

import json
import platform
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from volspec import __version__
from volspec._files import write_whole
from volspec.basis import basis_report
from volspec.export.compositing import save_for_compositors, scene_recipe
from volspec.export.contact_sheet import SheetColumn, contact_sheet
from volspec.export.frames import file_stem, write_frame
from volspec.export.page import PageSpec, PageView, write_page
from volspec.pipeline import Raycaster, Relighter
from volspec.scene import Scene, write_scene
from volspec.scene.tables import MaterialSpec
from volspec.spectra.files import rebase_path, split_address

Progress = Callable[[str, float], None]
_REPEATS = 5
_ROWS = ("As seen by an eye adapted to the light (CIECAM02)", "The same light without adaptation")


@dataclass(frozen=True, slots=True)
class LightReport:
    """Cost and error of one light."""

    name: str
    label: str
    relight_ms: float  # from a new light to the finished 8-bit frame; median of several
    ratio: float  # cast time over relight time
    # CIEDE2000 of the scene's materials against full spectra, in the scene's mode.
    delta_e_mean: float
    delta_e_max: float


@dataclass(frozen=True, slots=True)
class DemoReport:
    """Measurements of `run_demo`."""

    scene: str
    size: tuple[int, int]
    channels: int
    cast_device: str
    relight_device: str
    cast_ms: float
    lights: tuple[LightReport, ...]
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON types, with version and platform."""
        return {"volspec": __version__, "platform": platform.platform(), **asdict(self)}


def run_demo(
    scene: Scene, out: Path, progress: Progress, *, device: str | None = None
) -> DemoReport:
    """Cast a scene, relight it under each of its lights, and write all results to a folder.

    The files are ``frames/<light>.png``, ``sheet.png``, ``errors.png`` (a map of the basis's
    errors), ``<volume>.exr``, ``<volume>.html``, ``report.json``, and the scene itself with its
    volume and spectra (`copy_scene`). ``progress`` is called with a step's name and progress, 0…1;
    ``device`` is part of an OpenCL device's name.
    """
    begun = time.perf_counter()
    progress("read the volume", 0)
    volume = scene.volume()
    progress("read the volume", 1)
    progress("build the kernel", 0)
    caster = Raycaster(volume, device=device)
    scene.render(volume, caster=caster)
    progress("build the kernel", 1)
    started = time.perf_counter()
    image = scene.render(volume, caster=caster, progress=lambda done: progress("cast", done))
    cast_ms = 1e3 * (time.perf_counter() - started)
    columns, reports, frames, maps = [], [], {}, []
    materials = list(scene.materials.values())
    relit = scene.relight
    unadapted = replace(relit, viewing=replace(relit.viewing, model="none"))
    with Relighter(image) as relighter:
        for i, light in enumerate(scene.lights):
            times = []
            for _ in range(_REPEATS):
                started = time.perf_counter()
                frame = relighter.frame(light.rig, relit)
                times.append(1e3 * (time.perf_counter() - started))
            raw = relighter.frame(light.rig, unadapted)
            frames[light.name] = frame
            columns.append(SheetColumn(light.name, light.label, light.spectrum, [frame, raw]))
            errors = basis_report(scene.basis, light.rig.lights, materials)
            error = errors.errors[relit.mode]
            reports.append(
                LightReport(
                    light.name,
                    light.label,
                    median(times),
                    cast_ms / median(times),
                    error.mean,
                    error.max,
                )
            )
            maps.append(relighter.error_map(light.rig, relit.mode, relit.backdrop))
            progress("relight", (i + 1) / len(scene.lights))
        drawn_by = relighter.backend
    relight_ms = median(r.relight_ms for r in reports)
    title = (
        f"{scene.file.title or volume.name}: cast once in {cast_ms:.0f} ms, "
        f"relit in {relight_ms:.0f} ms per light"
    )
    sheet = contact_sheet(title, _ROWS, columns)
    # Files are written at the end, so that an interruption leaves nothing behind.
    recipe = scene_recipe(scene, scene.lights, relit)
    save_for_compositors(image, out / f"{Path(volume.name).stem}.exr", recipe)
    page = PageSpec(scene.file.title or volume.name)
    html = out / f"{Path(volume.name).stem}.html"
    write_page(html, [PageView(image)], scene.lights, relit, page)
    space = scene.relight.viewing.display.space
    for name, frame in frames.items():
        text = {"light": name, "Software": f"volspec {__version__}"}
        write_frame(out / "frames" / f"{file_stem(name)}.png", frame, text, space)
    write_frame(out / "sheet.png", sheet)
    top = max(error_map.top for error_map in maps)  # the same scale for all lights
    write_frame(out / "errors.png", np.hstack([error_map.image(top) for error_map in maps]))
    copy_scene(scene, out)
    result = DemoReport(
        scene=scene.file.title,
        size=image.size,
        channels=scene.basis.size,
        cast_device=image.notes["device"],
        relight_device=drawn_by,
        cast_ms=cast_ms,
        lights=tuple(reports),
        seconds=time.perf_counter() - begun,
    )
    with write_whole(out / "report.json") as temporary:
        temporary.write_text(json.dumps(result.to_dict(), indent=2) + "\n", encoding="utf-8")
    return result


def copy_scene(scene: Scene, folder: Path) -> Path:
    """Copy a scene, its volume, meshes and materials' spectra into a folder that can be moved.

    The volume has to be a file. Returns the new scene's path.
    """
    folder.mkdir(parents=True, exist_ok=True)

    def copied(name: str) -> str:
        """Copy a file of the scene; return its address, which is relative to the old scene."""
        source = scene.folder / name
        with write_whole(folder / source.name) as temporary:
            shutil.copyfile(source, temporary)
        return rebase_path(source.name, folder, scene.folder)

    def material(row: MaterialSpec) -> MaterialSpec:
        reflectance = row.reflectance
        address = split_address(reflectance) if isinstance(reflectance, str) else None
        if address is None:
            return row
        file, selector = address
        return replace(row, reflectance=copied(file) + (f"#{selector}" if selector else ""))

    file = replace(
        scene.file,
        volume=replace(scene.file.volume, file=copied(scene.file.volume.file)),
        material=tuple(map(material, scene.file.material)),
        mesh=tuple(row.rebased(copied) for row in scene.file.mesh),
    )
    return write_scene(file, folder / scene.path.name, scene)
