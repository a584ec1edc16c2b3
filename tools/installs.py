"""Check that volspec installs: resolve for every system, and install on this one.

    python -m tools.installs

uv resolves the requirements for four systems and four Pythons, from wheels alone. Then two
throw-away environments, one with the lowest versions that pyproject.toml allows and one with the
newest on the newest Python found here, install the package and run `volspec doctor`, `volspec demo`
and part of the tests. Exits with 1 if anything fails.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
UV = (sys.executable, "-m", "uv", "--no-python-downloads")
SYSTEMS = {
    "Linux x86-64": "x86_64-manylinux_2_28",
    "Linux aarch64": "aarch64-manylinux_2_28",
    "macOS 14 arm64": "aarch64-apple-darwin",
    "Windows x86-64": "x86_64-pc-windows-msvc",
}
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
EXTRAS = "test"
# Together, these use every requirement.
TESTS = (
    *("test_layers", "test_cli", "test_cli_basis", "test_scene", "test_scene_schema"),
    *("volume/test_files", "volume/test_series", "volume/test_tiff", "volume/test_zarr"),
    *("volume/test_pyvista", "raycast/test_image", "gpu/test_opencl", "twins/test_relight"),
    *("viewer/test_window",),
    *("palette/test_problem", "palette/test_palette_figure", "export/test_export_film"),
    *("notebook/test_widget", "spectra/test_construct"),
)


def resolves(system: str, python: str, *extras: str) -> str:
    """Resolve the requirements for a system; return uv's complaint, empty if they resolve."""
    command = (
        *(*UV, "pip", "compile", "--quiet", "pyproject.toml", *extras, "--only-binary", ":all:"),
        *("--python-platform", SYSTEMS[system], "--python-version", python),
    )
    # The first macOS version with imgui-bundle wheels.
    environment = {**os.environ, "MACOSX_DEPLOYMENT_TARGET": "14.0"}
    run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    return "" if run.returncode == 0 else " ".join(run.stderr.split()) or "uv failed"


def check_index() -> list[str]:
    """Print a table of what resolves; return a line for each combination that does not."""
    failures = []
    print(f"{'wheels alone':<28}" + "".join(f"{python:>6}" for python in PYTHONS))
    for what, extras in {"": (), ", all extras": ("--all-extras",)}.items():
        for system in SYSTEMS:
            found = {python: resolves(system, python, *extras) for python in PYTHONS}
            cells = "".join(f"{'no' if message else 'yes':>6}" for message in found.values())
            print(f"{system + what:<28}{cells}", flush=True)
            failures += [
                f"{system}{what}, {p}: {message}" for p, message in found.items() if message
            ]
    return failures


def newest_python() -> str:
    """Return the path of the newest CPython on this machine, including pyenv's."""
    words = (*UV, "python", "list", "--only-installed", "--output-format", "json")
    folders = [*map(str, Path.home().glob(".pyenv/versions/*/bin")), os.environ["PATH"]]
    environment = {**os.environ, "PATH": os.pathsep.join(folders)}
    said = subprocess.run(words, env=environment, capture_output=True, check=True).stdout
    found = json.loads(said)
    parts = [(p["version_parts"], p["path"]) for p in found if p["implementation"] == "cpython"]
    return str(max(parts, key=lambda p: (p[0]["major"], p[0]["minor"], p[0]["patch"]))[1])


def check_here(python: str, resolution: str) -> list[str]:
    """Install with a Python, run doctor, demo and tests; return what failed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inside = folder / "venv/bin/python"
        package = f"{ROOT}[{EXTRAS}]"
        steps = {
            "environment": (*UV, "venv", "--python", python, str(folder / "venv")),
            "install": (
                *(*UV, "pip", "install", "--python", str(inside), "--resolution", resolution),
                *("--only-binary", ":all:", "--no-binary", "volspec", package),
            ),
            "doctor": (str(inside), "-m", "volspec", "doctor"),
            "demo": (str(inside), "-m", "volspec", "demo", "--out", str(folder / "demo")),
            # Ignore warnings from old and newest versions of other packages.
            "tests": (
                *(str(inside), "-m", "pytest", "-W", "default", "-p", "no:cacheprovider"),
                *("-n", "auto", "--dist", "loadfile"),
                *(str(ROOT / "tests" / f"{test}.py") for test in TESTS),
            ),
        }
        for step, command in steps.items():
            # Outside the checkout, so that all but the tests use the installed package.
            run = subprocess.run(
                command,
                cwd=ROOT if step == "tests" else folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            if run.returncode:
                print(run.stdout)
                return [f"Python {python}, {resolution}: {step} failed"]
            last = (run.stdout.strip().splitlines() or ["done"])[-1]
            print(f"Python {python}, {resolution}: {step}: {last}", flush=True)
    return []


def main() -> None:
    failures = check_index()
    failures += check_here(PYTHONS[0], "lowest-direct")
    failures += check_here(newest_python(), "highest")
    sys.exit("\n".join(failures))


if __name__ == "__main__":
    main()
