"""Manifest in an export's folder, by which the export resumes.

    plan -> [manifest] -> exporter

Frames are written completely or not at all, and only next to the manifest of their own export. So
an existing frame is done unless its size has changed, or parts of the volume could not be read for
it; and the fingerprint identifies the folder of another scene.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from volspec import __version__
from volspec._files import clear_unfinished, write_whole
from volspec._parse import parse_json
from volspec.errors import InputError
from volspec.scene import Scene
from volspec.settings import plain
from volspec.spectra.library import sent_name
from volspec.volume import Volume

NAME = "export.json"
# Tables whose rows name files, and by which keys; of these, folders do not count.
_WITH_FILES = "field", "material", "light", "mesh"
_FILES = "file", "reflectance", "filter", "spectrum", "texture"


def fingerprint(scene: Scene, volumes: Iterable[Volume], settings: dict[str, Any]) -> str:
    """Return a hash that is equal for exports of equal frames, on the same device.

    Spectra, meshes and volumes, the steps of a series, are hashed by value; ``settings`` is JSON.
    """
    digest = hashlib.blake2b(digest_size=16)
    filters = getattr(scene.transfer, "filters", None) or {}
    shapes = []
    for volume in volumes:
        for field in (volume, *volume.fields):
            values = np.ascontiguousarray(field.values)
            digest.update(values.data.cast("B"))
            digest.update(np.ascontiguousarray(field.world_from_index, np.float64).data.cast("B"))
            labels = {str(number): label.name for number, label in field.labels.items()}
            shapes.append([field.file_name, str(values.dtype), values.shape, labels])
    lights = [spectrum for light in scene.lights for spectrum in light.rig.lights]
    for spectrum in [*scene.materials.values(), *filters.values(), *lights]:
        digest.update(np.stack([spectrum.wavelengths_nm, spectrum.values]).tobytes())
    for mesh in scene.surfaces():
        digest.update(mesh.digest())
    file = plain(scene.file)
    file.get("volume", {}).pop("file", None)  # values count, not the path
    for row in chain.from_iterable(file.get(name, []) for name in _WITH_FILES):
        names = {key: row[key] for key in _FILES if isinstance(row.get(key), str)}
        row |= {key: sent_name(text) for key, text in names.items()}
        if files := row.get("shares"):
            row["shares"] = {name: sent_name(text) for name, text in files.items()}
    file.pop("export", None)  # settings
    facts = {
        "volspec": __version__,
        "volume": shapes,
        "file": file,
        "lights": [[light.rig.weights, light.rig.illuminance_lux] for light in scene.lights],
        "viewing": plain(scene.relight),
        # A trained basis follows from the other facts.
        "basis": scene.basis.to_dict() if scene.file.basis.file else scene.basis.name,
        "raycast": repr(scene.raycast),
        "transfer": repr(scene.transfer),
        **settings,
    }
    digest.update(json.dumps(facts, sort_keys=True, default=str).encode())
    return digest.hexdigest()


@dataclass(frozen=True, slots=True)
class ExportFolder:
    """Folder of an export."""

    path: Path
    fingerprint: str
    files: tuple[str, ...]  # all files but the manifest

    def begin(self, overwrite: bool = False, own: bool = False) -> None:
        """Start or resume in an existing folder; remove the remains of another export.

        ``own`` is True for the exporter's own folder, in which another scene's may be deleted.
        """
        old = self._old()
        if self.is_own():
            self._clear_unfinished(self.files)
            for name in self.missing():
                self._remove(name)
            self.record_sizes(gaps={})
            return
        if old is not None and not (overwrite or own):
            raise InputError(
                f"{self.path}: has the export of another scene or other settings",
                "choose another folder, or add --overwrite to replace its frames",
                code="conflict",
            )
        existing = next((name for name in self.files if (self.path / name).exists()), None)
        if old is None and existing is not None and not overwrite:
            damaged = (self.path / NAME).exists()
            why = f"its {NAME} cannot be read" if damaged else "is not from an export"
            raise InputError(
                f"{self.path / existing}: exists already, and {why}; choose another folder, or add "
                "--overwrite",
                code="duplicate",
            )
        files = (old or {}).get("files", ())
        names = [*map(str, files if isinstance(files, list) else ()), *self.files]
        self._clear_unfinished(names)
        for name in names:
            self._remove(name)
        self._write({}, {})

    def record_sizes(self, gaps: dict[str, str] | None = None) -> None:
        """Record the sizes of existing files, from which `missing` detects damage.

        A full disk is not an error: files without a recorded size count as complete. ``gaps``
        replace the recorded ones.
        """
        missing = self.missing()
        existing = (name for name in self.files if name not in missing)
        with suppress(InputError, OSError):
            sizes = {name: (self.path / name).stat().st_size for name in existing}
            self._write(sizes, self.gaps() if gaps is None else gaps)

    def record_gaps(self, names: Iterable[str], gaps: str) -> None:
        """Record that files lack parts of the volume, before they are written."""
        self._write(self._recorded("sizes"), self.gaps() | dict.fromkeys(names, gaps))

    def gaps(self) -> dict[str, str]:
        """Return a sentence about what could not be read for each file with gaps."""
        return self._recorded("gaps")

    def missing(self) -> set[str]:
        """Return the files to write: absent, empty, not of the recorded size, or with gaps."""
        sizes, gaps = self._recorded("sizes"), self.gaps()
        return {
            name
            for name in self.files
            if name in gaps or not _is_complete(self.path / name, sizes.get(name))
        }

    def _recorded(self, key: str) -> dict[str, Any]:
        record = (self._old() or {}).get(key)
        return record if isinstance(record, dict) else {}

    def remove(self) -> None:
        """Delete the files, and the folder if nothing else is in it."""
        for name in (*self.files, NAME):
            self._remove(name)
        with suppress(OSError):
            self.path.rmdir()

    def remove_unless_begun(self) -> None:
        """Delete the manifest and the folder after an error, unless a frame is done."""
        if self.is_own() and len(self.missing()) == len(self.files):
            self.remove()
        with suppress(OSError):
            self.path.rmdir()

    def is_own(self) -> bool:
        """Return True if the folder has this export's manifest."""
        return (self._old() or {}).get("fingerprint") == self.fingerprint

    def _write(self, sizes: dict[str, int], gaps: dict[str, str]) -> None:
        manifest = {
            "volspec": __version__,
            "fingerprint": self.fingerprint,
            "files": list(self.files),
            "sizes": sizes,
            **({"gaps": gaps} if gaps else {}),
        }
        with write_whole(self.path / NAME) as temporary:
            text = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
            temporary.write_text(text, encoding="utf-8")

    def _old(self) -> dict[str, Any] | None:
        try:
            manifest = parse_json((self.path / NAME).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return manifest if isinstance(manifest, dict) and "fingerprint" in manifest else None

    def _remove(self, name: str) -> None:
        """Delete a frame of the last export."""
        path = self._inside(name)
        if path is not None and path.suffix in (".png", ".avif", ".exr", ".json"):
            with suppress(FileNotFoundError):
                path.unlink()
            if path.parent != self.path.resolve():
                with suppress(OSError):
                    path.parent.rmdir()

    def _clear_unfinished(self, names: Iterable[str]) -> None:
        paths = [self._inside(name) for name in (*names, NAME)]
        for folder in {path.parent for path in paths if path is not None}:
            clear_unfinished(folder)

    def _inside(self, name: str) -> Path | None:
        """Return a file's path; None if the name leads out of the folder or is invalid."""
        try:
            os.fsencode(name)
            path = (self.path / name).resolve()
        except (OSError, ValueError):  # too long, a NUL character, not text
            return None
        return path if path.is_relative_to(self.path.resolve()) else None


def _is_complete(path: Path, recorded: object) -> bool:
    """Return True if a file is not empty and has the recorded size, if any."""
    size = path.stat().st_size if path.is_file() else 0
    return size > 0 and recorded in (None, size)
