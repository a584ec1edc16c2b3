"""``volspec demo``: the bundled scene, from cast to contact sheet."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from volspec._files import require_writable
from volspec.cli.shell import Device, Json, Terminal, app, bar, print_json


@app.command
def demo(*, out: Path = Path("volspec-demo"), device: Device = None, json: Json = False) -> None:
    """The bundled engine CT: cast once, relit under five lights.

    Writes relit frames, a labelled contact sheet, a relightable web page, the coefficient image and
    a report.

    Example: `volspec demo --out engine-demo`

    Parameters
    ----------
    out
        Folder to write to.
    """
    from volspec._gpu.sources import asset
    from volspec.export.demo import run_demo
    from volspec.scene import Scene

    require_writable(out / "sheet.png")
    with bar(quiet=json) as tell:
        tell("fit the basis", 0)
        scene = Scene.load(asset("data/scenes/engine.toml"))
        tell("fit the basis", 1)
        report = run_demo(scene, out, tell, device=device)
    if json:
        print_json(report.to_dict())
        return
    console = Terminal()
    table = Table(
        title=f"{report.scene}, {report.size[0]}×{report.size[1]}, {report.channels} channels: "
        f"cast in {report.cast_ms:.0f} ms"
    )
    table.add_column("light")
    table.add_column("", no_wrap=True)
    for heading in ("relight ms", "cast / relight", "ΔE00 mean", "max"):
        table.add_column(heading, justify="right")
    for row in report.lights:
        errors = (_error(row.delta_e_mean), _error(row.delta_e_max))
        table.add_row(row.name, row.label, f"{row.relight_ms:.1f}", f"{row.ratio:.0f}", *errors)
    console.print(table)
    console.print(
        "ΔE00: the basis's error on the scene's materials under its lights, against full spectra.\n"
        f"Cast on {report.cast_device}; relit on {report.relight_device}.\n"
        f"Written in {report.seconds:.1f} s to {out}/: open {out}/sheet.png",
        highlight=False,
    )


def _error(delta_e: float) -> str:
    return f"{delta_e:.3f}" if delta_e >= 0.001 else "< 0.001"
