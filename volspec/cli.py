"""The command line: thin, every command a few calls into the package.

Exit codes: 0 done, 1 bad input or missing device (one line on stderr; ``--debug`` shows the
traceback), 2 usage.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from volspec import __version__
from volspec.errors import ImageError, VolspecError, VolspecWarning

app = App(
    name="volspec",
    help="Swap the light on a volume: cast once with spectral materials, relight for ever.",
    version=__version__,
    help_format="markdown",
)

Device = Annotated[str | None, Parameter(help="Part of an OpenCL device's name.")]
Json = Annotated[bool, Parameter(name="--json", negative="", help="Print figures as JSON.")]


@app.command
def demo(*, out: Path = Path("volspec-demo"), device: Device = None, json: Json = False) -> None:
    """The bundled engine CT: cast once, relit under five lights.

    Writes relit frames, a labelled contact sheet, the coefficient image and a report.

    Example: `volspec demo --out engine-demo`

    Parameters
    ----------
    out
        Folder to write to.
    """
    from volspec._gpu.sources import asset
    from volspec.export.demo import run_demo
    from volspec.scene import Scene

    with _bar(quiet=json) as tell:
        tell("fit the basis", 0)
        scene = Scene.load(asset("data/scenes/engine.toml"))
        tell("fit the basis", 1)
        report = run_demo(scene, out, tell, device=device)
    if json:
        _print_json(report.to_dict())
        return
    console = Console()
    table = Table(
        title=f"{report.scene}, {report.size[0]}×{report.size[1]}, {report.channels} channels"
    )
    for heading in ("light", "", "cast ms", "relight ms", "ratio", "ΔE00 mean", "ΔE00 max"):
        table.add_column(heading, justify="left" if heading in ("light", "") else "right")
    for i, row in enumerate(report.lights):
        table.add_row(
            row.name,
            row.label,
            f"{report.cast_ms:.0f}" if i == 0 else "–",
            f"{row.relight_ms:.1f}",
            f"{row.ratio:.0f}×",
            _error(row.delta_e_mean),
            _error(row.delta_e_max),
        )
    console.print(table)
    console.print(
        "ΔE00: the basis's error on the scene's materials, componentwise against full spectra.\n"
        f"Cast on {report.cast_device}; relit on {report.relight_device}.\n"
        f"Written in {report.seconds:.1f} s to {out}/: open {out}/sheet.png",
        highlight=False,
    )


@app.command
def doctor(*, json: Json = False) -> None:
    """OpenCL and GL devices, versions, which will be used, what is missing.

    Example: `volspec doctor`
    """
    from volspec.doctor import examine

    report = examine()
    if json:
        _print_json(report.to_dict())
    else:
        report.print(Console())
    if not report.healthy:
        raise SystemExit(1)


@app.command
def info(volume: str, /, *, json: Json = False) -> None:
    """Size, spacing, orientation, range and histogram of a volume.

    Example: `volspec info engine.nrrd`

    Parameters
    ----------
    volume
        A volume file, or `FILE.raw?shape=256x256x110&dtype=uint8`.
    """
    from volspec.volume import load_volume
    from volspec.volume.summary import summarize

    summary = summarize(load_volume(volume))
    if json:
        _print_json(summary.to_dict())
    else:
        Console().print(summary.table())


@app.command
def render(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    device: Device = None,
) -> None:
    """Cast a scene once into a coefficient image.

    Example: `volspec render engine.toml -o engine.exr`

    Parameters
    ----------
    scene
        A scene file.
    output
        The OpenEXR file to write.
    """
    from volspec.scene import Scene

    if output.suffix.lower() != ".exr":
        raise ImageError(f"{output}: coefficient images are OpenEXR; name it .exr")
    with _bar() as tell:
        tell("load the scene", 0)
        loaded = Scene.load(scene)
        tell("load the scene", 1)
        image = loaded.render(device=device, progress=lambda share: tell("cast", share))
    image.save(output)
    Console().print(f"{output}: {image.size[0]}×{image.size[1]}, {image.basis.size} channels")


@app.command
def relight(
    image: Path,
    /,
    *,
    light: Annotated[list[str], Parameter(help="D65, planck:3200, D65*0.7+A*0.3, FILE.csv …")],
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    model: str = "CIECAM02",
    mode: str = "componentwise",
    backdrop: float = 0.2,
) -> None:
    """Relight a stored coefficient image.

    Example: `volspec relight engine.exr --light A --light FL2 -o engine.png`

    Parameters
    ----------
    image
        A coefficient image that `volspec render` or `volspec demo` wrote.
    output
        The PNG file; with several lights the name gets the light's: `engine-A.png`.
    model
        What the eye makes of it: CIECAM02, or none (no adaptation).
    mode
        componentwise, or exact (the light matrix).
    backdrop
        Reflectance of the diffuser behind, 0 to 1.
    """
    from volspec.appearance import Viewing
    from volspec.export.frames import file_stem, write_frame
    from volspec.pipeline import Relighter
    from volspec.raycast import CoefficientImage
    from volspec.spectra import light as light_of

    if output.suffix.lower() != ".png":
        raise ImageError(f"{output}: frames are PNG files; name it .png")
    spectra = [light_of(text) for text in light]
    viewing = Viewing(model=model)
    with Relighter(CoefficientImage.load(image)) as relighter:
        for text, spectrum in zip(light, spectra, strict=True):
            frame = relighter.frame(spectrum, viewing, mode, backdrop)
            stem = f"{output.stem}-{file_stem(text)}" if len(light) > 1 else output.stem
            path = output.with_name(f"{stem}.png")
            write_frame(path, frame, {"light": text, "Software": f"volspec {__version__}"})
            Console().print(f"{path}", highlight=False)


def _error(delta_e: float) -> str:
    return f"{delta_e:.3f}" if delta_e >= 0.001 else "< 0.001"


class _bar:
    """A progress bar on stderr with one line a step; silent when asked."""

    def __init__(self, quiet: bool = False) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            disable=quiet,
        )
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> _bar:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def __call__(self, step: str, share: float) -> None:
        if step not in self._tasks:
            self._tasks[step] = self._progress.add_task(step, total=1.0)
        self._progress.update(self._tasks[step], completed=share)


def _print_json(data: dict[str, Any]) -> None:
    print(json.dumps(data, indent=2))


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
) -> None:
    if issubclass(category, VolspecWarning):
        print(f"volspec: warning: {message}", file=sys.stderr)


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the ``volspec`` command."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    warnings.showwarning = _show_warning
    try:
        app(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        print(f"volspec: {' '.join(str(error).split())}; see volspec --help", file=sys.stderr)
        raise SystemExit(2) from error
    except VolspecError as error:
        if debug:
            raise
        print(f"volspec: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(1) from error
    except BrokenPipeError:
        # The reader of a pipe closed early, as `| head` does.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        print("volspec: interrupted; nothing half-written is left", file=sys.stderr)
        raise SystemExit(130) from None
