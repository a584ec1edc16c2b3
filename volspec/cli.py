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
from volspec._files import require_writable
from volspec.errors import ImageError, VolspecError, VolspecWarning

app = App(
    name="volspec",
    help="Swap the light on a volume: cast once with spectral materials, relight for ever.",
    version=__version__,
    help_format="markdown",
    suppress_keyboard_interrupt=False,
)

# CIEDE2000 that an eye notices at a glance; below, componentwise colours pass for exact.
NOTICEABLE = 3.0

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

    require_writable(out / "sheet.png")
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
        A volume file, or `FILE.raw?shape=256x256x110&dtype=uint8&spacing=1,1,1`.
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
    require_writable(output)
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
    light: Annotated[
        list[str],
        Parameter(negative="", help=r"D65, planck:3200, D65\*0.7+A\*0.3, FILE.csv; repeatable."),
    ],
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    model: str | None = None,
    mode: str | None = None,
    backdrop: float | None = None,
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
        What the eye makes of it: CIECAM02, or none (no adaptation). As in the scene when left out.
    mode
        componentwise, or exact (the light matrix). As in the scene when left out.
    backdrop
        Reflectance of the diffuser behind, 0 to 1. As in the scene when left out.
    """
    from volspec.export.frames import file_stem, write_frame
    from volspec.pipeline import Relighter
    from volspec.raycast import CoefficientImage
    from volspec.relight import componentwise_error
    from volspec.scene import viewing_of
    from volspec.spectra import light as light_of

    if output.suffix.lower() != ".png":
        raise ImageError(f"{output}: frames are PNG files; name it .png")
    stems = [f"-{file_stem(text)}" if len(light) > 1 else "" for text in light]
    paths = [output.with_name(f"{output.stem}{stem}{output.suffix}") for stem in stems]
    if len({str(path).lower() for path in paths}) < len(paths):
        raise ImageError(f"{output}: two lights would be written to one file; give one at a time")
    for path in paths:
        require_writable(path)
    stored = CoefficientImage.load(image)
    given = {"model": model, "mode": mode, "backdrop": backdrop}
    table = viewing_of(stored).model_copy(update={k: v for k, v in given.items() if v is not None})
    spec = table.spec()
    spectra = [light_of(text, stored.basis.grid) for text in light]
    with Relighter(stored) as relighter:
        for text, spectrum, path in zip(light, spectra, paths, strict=True):
            frame = relighter.frame(spectrum, spec.viewing, spec.mode, spec.backdrop, spec.level)
            write_frame(path, frame, {"light": text, "Software": f"volspec {__version__}"})
            Console().print(f"{path}", highlight=False)
            off = componentwise_error(stored, spectrum) if spec.mode == "componentwise" else 0.0
            if off > NOTICEABLE:
                warnings.warn(
                    f"{text}: the componentwise colours are off by ΔE00 {off:.1f}, since the "
                    f"image's basis {stored.basis.name!r} was trained on other lights; "
                    "--mode exact shows them right",
                    VolspecWarning,
                    stacklevel=1,
                )


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
