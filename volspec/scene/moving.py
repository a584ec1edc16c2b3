"""A scene's file as it reads from another folder.

SceneFile -> [moving] -> writing
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from volspec.errors import SceneError, SpectrumError
from volspec.scene.file import SceneFile
from volspec.scene.lights import LightTable
from volspec.scene.tables import MaterialTable
from volspec.spectra.files import rebase_address, rebase_path
from volspec.spectra.lights import rebase_light


def moved_scene(file: SceneFile, folder: Path, path: Path) -> SceneFile:
    """The same scene, for a file that stands elsewhere: every name of a file leads there.

    Parameters
    ----------
    file : SceneFile
    folder : path
        What relative names in it start from.
    path : path
        The new file.

    Raises
    ------
    SceneError
        If a mix of lights cannot be read.
    """
    to = path.parent
    if folder.resolve() == to.resolve():
        return file

    def material(row: MaterialTable) -> MaterialTable:
        names = {"reflectance": row.reflectance, "filter": row.filter}
        texts = {key: name for key, name in names.items() if isinstance(name, str)}
        moved = {key: rebase_address(name, folder, to) for key, name in texts.items()}
        return row.model_copy(update=moved)

    def light(row: LightTable) -> LightTable:
        if not isinstance(row.spectrum, str):
            return row
        try:
            moved = rebase_light(row.spectrum, folder, to)
        except SpectrumError as error:
            raise SceneError(f"{path}: [[light]] {row.name}: {error}") from error
        return row.model_copy(update={"spectrum": moved})

    volume, _, query = file.volume.file.partition("?")
    moved = rebase_path(volume, folder, to) + (f"?{query}" if query else "")
    update: dict[str, Any] = {
        "volume": file.volume.model_copy(update={"file": moved}),
        "material": [material(row) for row in file.material],
        "light": [light(row) for row in file.light],
    }
    if file.basis.file is not None:
        name = rebase_path(file.basis.file, folder, to)
        update["basis"] = file.basis.model_copy(update={"name": name})
    display = file.viewing.display
    if display.profile is not None:
        display = display.model_copy(update={"space": rebase_path(display.profile, folder, to)})
        update["viewing"] = file.viewing.model_copy(update={"display": display})
    return file.model_copy(update=update)
