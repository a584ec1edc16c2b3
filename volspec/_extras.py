"""Packages that only some uses need, and the extras by which they are installed."""

from __future__ import annotations

from importlib.util import find_spec

from volspec.errors import DeviceError

EXTRAS = {
    "viewer": ("glfw", "imgui_bundle", "OpenGL", "copykitten", "psutil"),
    "vtk": ("pyvista",),
    "rooms": ("embreex",),
    "dicom": ("gdcm",),
    "mrc": ("mrcfile",),
    "hdf5": ("h5py",),
    "zarr": ("zarr", "tensorstore"),
    "micro": ("pylibCZIrw", "liffile", "nd2", "oiffile"),
    "remote": ("upath", "fsspec", "aiohttp"),
    "cluster": ("dask", "distributed"),
    "serve": ("tornado",),
    "notebook": ("anywidget",),
    "video": ("imageio_ffmpeg",),
}
"""Modules by the extra that installs them."""


def install_command(extra: str) -> str:
    """Return the command that installs an extra.

    >>> install_command("vtk")
    'pip install "volspec[vtk]"'
    """
    return f'pip install "volspec[{extra}]"'


def require_extra(extra: str, user: str, otherwise: str = "") -> None:
    """Raise DeviceError unless an extra is installed, which ``user`` needs: its name.

    ``otherwise`` is another remedy.
    """
    missing = [module for module in EXTRAS[extra] if find_spec(module) is None]
    if missing:
        raise DeviceError(
            f"{user}: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not installed",
            install_command(extra) + (otherwise and f", or {otherwise}"),
            code="unsupported",
        )
