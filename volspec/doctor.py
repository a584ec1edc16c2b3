"""Diagnose this machine: OpenCL and GL devices, versions, and remedies for missing ones.

Every OpenCL device is tested. Casts run on the first that works; to choose another, set
``VOLSPEC_DEVICE`` to a part of its device, platform or driver name, or to the number shown here.
"""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from typing import TYPE_CHECKING, Any

from volspec import __version__
from volspec._extras import EXTRAS, install_command
from volspec._gpu import DeviceInfo, try_all
from volspec._gpu import device_list as opencl_devices
from volspec.errors import DeviceError, OpenCLError, OpenGLError
from volspec.raycast.launch import choose_packet

if TYPE_CHECKING:
    from rich.console import Console

_PACKAGES = (
    *("numpy", "scipy", "pyopencl", "pocl-binary-distribution", "moderngl", "pydicom"),
    *("nibabel", "colour-science", "OpenEXR"),
)
_NOT_HERE = "not here"
# Features by the package's extra.
_FEATURES = {
    "the window": "viewer",
    "VTK, meshes": "vtk",
    "rays of meshes, rooms": "rooms",
    "compressed DICOM": "dicom",
    "MRC": "mrc",
    "notebooks": "notebook",
    "OME-Zarr": "zarr",
    "HDF5": "hdf5",
    "microscopes": "micro",
    "URLs": "remote",
    "several machines": "cluster",
    "pages from a server": "serve",
}


@dataclass(frozen=True, slots=True)
class Examination:
    """Result of `examine`."""

    python: str
    versions: dict[str, str]
    opencl: tuple[DeviceInfo, ...]
    faults: tuple[str, ...]  # why a device cannot run a kernel; empty if it can
    casts_on: int | None  # index of the device for casts
    packets: str  # how that device marches rays
    gl: str | None  # renderer and version of the headless context
    no_sharing: str | None  # reason that casts cannot pass pictures to GL on the device, if so
    extras: dict[str, str]  # optional features: versions, or the command that installs them
    problems: tuple[str, ...]  # missing parts, each with the command that installs it
    healthy: bool  # pictures can be made, if slowly without GL

    def to_dict(self) -> dict[str, Any]:
        """Convert to JSON types."""
        return {"volspec": __version__, **asdict(self)}

    def print(self, console: Console) -> None:
        """Print the result as a table."""
        from rich.markup import escape
        from rich.table import Table

        table = Table(title=f"volspec {__version__}, {self.python}", show_header=False)
        for i, device in enumerate(self.opencl):
            memory = f"{device.memory_bytes / 2**30:.1f} GiB"
            used = ""
            if i == self.casts_on:
                used = f"  [green]casts run here[/green], in {escape(self.packets)}"
            if self.faults[i]:
                used = f"  [red]not used:[/red] {escape(self.faults[i])}"
            table.add_row(
                f"OpenCL {i}",
                f"{escape(device.name)}{used}\n{escape(device.platform)} {escape(device.driver)}, "
                f"{device.compute_units} compute units, {memory}",
            )
        if not self.opencl:
            table.add_row("OpenCL", "[red]no device[/red]")
        variable = os.environ.get(opencl_devices.DEVICE_VARIABLE)
        table.add_row(
            opencl_devices.DEVICE_VARIABLE,
            escape(variable)
            if variable
            else "not set; a number or part of a name chooses a device",
        )
        table.add_row("GL", self.gl or "[yellow]no context: relighting uses NumPy[/yellow]")
        table.add_row("CL-GL sharing", escape(self.no_sharing or "offered: Raycaster(context=…)"))
        for name, state in self.extras.items():
            table.add_row(name, escape(state))
        table.add_row("versions", "\n".join(f"{k} {v}" for k, v in self.versions.items()))
        console.print(table)
        for problem in self.problems:
            console.print(f"[red]missing:[/red] {escape(problem)}", highlight=False, soft_wrap=True)
        if not self.problems:
            left = [name for name, state in self.extras.items() if state.startswith(_NOT_HERE)]
            extras = f"; extras that are not here: {', '.join(left)}" if left else ""
            console.print(f"nothing that is needed is missing{extras}", soft_wrap=True)


def examine() -> Examination:
    """Find devices and versions; never raises."""
    problems = []
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            # Some systems have no wheels for these; missing devices are reported in their rows.
            if package not in ("pocl-binary-distribution", "moderngl"):
                problems.append(f"{package}: pip install {package}")
    devices = opencl_devices.devices()
    faults = try_all(devices)
    casts_on, packets = None, ""
    try:
        casts_on = opencl_devices.choose_device()
        packets = str(choose_packet(casts_on))
    except OpenCLError as error:
        problems.append(str(error))
    blocked = bool(problems)
    gl = None
    no_sharing: str | None = "no OpenGL context"
    if casts_on is None:
        no_sharing = "no device for casts" if devices else "no OpenCL device"
    try:
        from volspec._gpu import describe, headless_context, sharing_fault

        context = headless_context()
        details = describe(context)
        gl = f"{details['device']}, OpenGL {details['version']}"
        if casts_on is not None:
            no_sharing = sharing_fault(opencl_devices.all_devices()[casts_on], context)
        context.release()
    except (OpenGLError, ImportError) as error:
        problems.append(str(error))
    return Examination(
        python=f"Python {platform.python_version()} on {platform.system()} {platform.machine()}",
        versions=versions,
        opencl=tuple(devices),
        faults=faults,
        casts_on=casts_on,
        packets=packets,
        gl=gl,
        no_sharing=no_sharing,
        extras=_extras(),
        problems=tuple(problems),
        healthy=bool(devices) and not blocked,
    )


def _extras() -> dict[str, str]:
    """Return optional features: their versions, or the command that installs them."""
    features = {"films": _ffmpeg() or _remedy("video")}
    by_module = packages_distributions()
    for feature, extra in _FEATURES.items():
        packages = [by_module.get(module, [""])[0] for module in EXTRAS[extra]]
        try:
            features[feature] = ", ".join(f"{package} {version(package)}" for package in packages)
        except (PackageNotFoundError, ValueError):  # the latter of a module without a package
            features[feature] = _remedy(extra)
    return features


def _ffmpeg() -> str | None:
    """Return ffmpeg's version for films, or the reason that it is unusable; None without it."""
    try:
        from imageio_ffmpeg import get_ffmpeg_version

        from volspec.export import ffmpeg

        ffmpeg()
        return f"ffmpeg {get_ffmpeg_version()}, imageio-ffmpeg {version('imageio-ffmpeg')}"
    except DeviceError as error:
        return f"{_NOT_HERE}: {str(error).removeprefix('export: ')}"
    except (ImportError, RuntimeError, OSError):
        return None


def _remedy(extra: str) -> str:
    return f"{_NOT_HERE}: {install_command(extra)}"
