"""``volspec doctor`` and ``volspec info``: what there is, before anything is cast."""

from __future__ import annotations

from rich.console import Console

from volspec.cli.shell import Json, app, print_json


@app.command
def doctor(*, json: Json = False) -> None:
    """OpenCL and GL devices, versions, which will be used, what is missing.

    Example: `volspec doctor`
    """
    from volspec.doctor import examine

    report = examine()
    if json:
        print_json(report.to_dict())
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
        print_json(summary.to_dict())
    else:
        Console().print(summary.table())
