"""Shared fixtures: volumes, small scenes, and devices, with skips if one is missing."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from volspec._gpu.opencl import Compute
from volspec._gpu.opengl import headless_context
from volspec.errors import DeviceError, OpenGLError
from volspec.raycast.launch import packets
from volspec.spectra.datasets import colour_science
from volspec.transfer import TransferTable
from volspec.volume import Volume, load_volume

pytest_plugins = ["tests.support.tiers"]
ROOT = Path(__file__).resolve().parent.parent

# Test files import colour-science directly, which changes NumPy's print options, so this is first.
colour_science()
# The same examples in every run, and no deadline, as the machine may be busy.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("repeatable")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--remake", action="store_true", help="write tests/cli/transcripts")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the devices used."""
    terminalreporter.write_line(devices_line())


def devices_line() -> str:
    """Return the OpenCL device with its platform and driver, and the GL renderer, in one line."""
    try:
        device = Compute.open().context.devices[0]
        names = (device.name, device.platform.name, f"driver {device.driver_version}")
        opencl = ", ".join(name.strip() for name in names)
    except DeviceError as error:
        opencl = f"none ({error})"
    try:
        gl = headless_context()
        opengl = gl.info["GL_RENDERER"]
        gl.release()
    except DeviceError as error:
        opengl = f"none ({error})"
    return f"OpenCL: {opencl}; OpenGL: {opengl}"


@pytest.fixture(autouse=True, scope="session")
def _own_cache(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[None]:
    """Use a cache of the run's workers and children, empty at first, instead of the user's.

    Compiled programs stay in the user's. The packet of rays is not chosen by trial, as the trial
    takes seconds and its outcome depends on what else the machine does.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "cache"
    programs = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    with pytest.MonkeyPatch.context() as patched:
        for variable, name in (("POCL_CACHE_DIR", "pocl/kcache"), ("MESA_SHADER_CACHE_DIR", "")):
            patched.setenv(variable, os.environ.get(variable) or str(programs / name))
        patched.setenv("XDG_CACHE_HOME", str(folder))
        patched.setattr("volspec._cache.cache_folder", lambda: folder / "volspec")
        patched.setattr(packets, "_try", lambda index, known: {})
        if not request.config.option.quick:
            with suppress(DeviceError):  # children read it from the cache
                packets.choose_packet(Compute.open().index)
        yield


@pytest.fixture(scope="session")
def engine() -> Volume:
    """The bundled engine CT, 256 x 256 x 110."""
    return load_volume(ROOT / "data" / "engine.nrrd")


@pytest.fixture(scope="session")
def half_engine(engine: Volume) -> Volume:
    """The engine in an eighth of its voxels, for references that visit each of them."""
    return engine.downsampled(2)


@pytest.fixture(scope="session")
def volumes() -> Path:
    """The folder of the larger real volumes, which are not shipped."""
    for folder in (os.environ.get("VOLSPEC_DATA"), ROOT.parent / "shared" / "data"):
        if folder and Path(folder).is_dir():
            return Path(folder)
    pytest.skip("the larger volumes are not here; set VOLSPEC_DATA to their folder")


@pytest.fixture(scope="session")
def engine_table() -> TransferTable:
    """Seven channels over the engine's values: a translucent block, denser inserts."""
    rng = np.random.default_rng(2)
    at = np.linspace(50, 255, 1024)
    opacity = np.interp(at, [50, 60, 90, 160, 180, 255], [0, 0, 0.03, 0.1, 0.5, 0.5])
    knots = [50, 120, 200, 255]
    channels = [np.interp(at, knots, rng.uniform(0.1, 0.9, 4)) for _ in range(7)]
    return TransferTable((50.0, 255.0), opacity, np.stack(channels, axis=1), 1.0)


@pytest.fixture(scope="session")
def three_channels(engine_table: TransferTable) -> TransferTable:
    """The first three channels: a kernel for eight rays then compiles in 2/3 of the time."""
    table = engine_table
    return TransferTable(
        table.domain, table.opacity, table.material_weights[:, :3], table.reference_step_mm
    )


@pytest.fixture
def context() -> Iterator[Any]:
    """A headless moderngl.Context, current."""
    try:
        made = headless_context()
    except OpenGLError as error:
        pytest.skip(str(error))
    yield made
    made.release()


@pytest.fixture(scope="session")
def needs_opencl() -> None:
    """Skip where there is no OpenCL device."""
    Compute.open()


@pytest.fixture(scope="session")
def needs_gl() -> None:
    """Skip where there is no OpenGL."""
    try:
        headless_context().release()
    except OpenGLError as error:
        pytest.skip(str(error))


@pytest.fixture(params=["gl", "numpy"])
def backend(request: pytest.FixtureRequest) -> str:
    """Name of each relighting backend."""
    if request.param == "gl":
        request.getfixturevalue("needs_gl")
    return str(request.param)
