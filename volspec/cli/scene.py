"""``volspec scene``: scene files read without being cast, and the schema that editors read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App

from volspec.cli.shell import Json, app, counted, print_json, say
from volspec.errors import one_line

if TYPE_CHECKING:
    from volspec.export.plan import Checked

scene = App(name="scene", help="Check scene files; their JSON schema.")
app.command(scene)


@scene.command
def check(files: list[Path], /, *, json: Json = False) -> None:
    """Read scenes and look up all that they name; nothing is cast.

    A line for each file that is well, and for each error one that names file, field, value and
    remedy. Exit code 1 where there is one.

    Example: `volspec scene check engine.toml`

    Parameters
    ----------
    files
        Scene files.
    """
    from volspec.export.plan import check_scene

    found = [check_scene(file) for file in files]
    if json:
        print_json([each.to_dict() for each in found])
    else:
        for each in found:
            for line in each.errors or (_line(each),):
                say(one_line(line))
    if any(each.errors for each in found):
        raise SystemExit(1)


@scene.command
def schema() -> None:
    """Print the JSON schema of scene files, for editors of TOML.

    Example: `volspec scene schema > scene.schema.json`
    """
    from volspec.scene.schema import scene_schema_text

    print(scene_schema_text(), end="")


def _line(checked: Checked) -> str:
    size = " × ".join(map(str, checked.volume or ()))
    return (
        f"{checked.path}: ok: {counted(checked.materials, 'material')}, "
        f"{counted(checked.lights, 'light')}, volume {size}, basis {checked.basis} "
        f"({checked.reason})"
    )
