"""The rules of the house, executed: who may import whom, and what stays light."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from volspec import _extras
from volspec._extras import EXTRAS
from volspec.errors import DeviceError

ROOT = Path(__file__).resolve().parent.parent / "volspec"

# A module imports only from its left (docs/decisions/0002 puts the pipeline before the scene).
LAYERS = (
    *("errors", "_extras", "_confine", "_files", "_cache", "_child", "_parse", "_toml"),
    *("settings", "_checks", "_exr", "_text", "_gpu", "_triangles", "spectra", "appearance"),
    *("_figures", "basis", "palette", "volume", "transfer", "camera", "image", "raycast", "mesh"),
    *("room", "large", "relight", "pipeline", "scene", "wizard", "export"),
    *("doctor", "viewer", "cli"),
)
MODULES = sorted(path for path in ROOT.rglob("*.py") if path.parent != ROOT or path.stem in LAYERS)


@cache
def statements(path: Path) -> list[tuple[ast.Import | ast.ImportFrom, bool]]:
    """(statement, whether at module level) of every import in a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    top = set(map(id, tree.body))
    kinds = ast.Import | ast.ImportFrom
    return [(node, id(node) in top) for node in ast.walk(tree) if isinstance(node, kinds)]


def imports(path: Path) -> list[tuple[str, bool]]:
    """(module, whether at module level) of every import in a file."""
    found = []
    for node, at_top in statements(path):
        if isinstance(node, ast.Import):
            found += [(alias.name, at_top) for alias in node.names]
        else:
            assert node.level == 0, f"{path}: relative import"
            found.append((node.module or "", at_top))
    return found


def layer(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


@cache
def door(package: Path) -> dict[str, Path]:
    """Names that a package gives to others, and the files that define them."""
    stub = package / "__init__.pyi"
    tree = ast.parse((stub if stub.exists() else package / "__init__.py").read_text("utf-8"))
    names = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and stub.exists():
            for alias in node.names:
                place = package.joinpath(*(node.module or alias.name).split("."))
                names[alias.name] = file_of(place)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names[node.name] = package / "__init__.py"
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            bound = (each for target in targets for each in ast.walk(target))
            names |= {n.id: package / "__init__.py" for n in bound if isinstance(n, ast.Name)}
    return names


def file_of(place: Path) -> Path:
    """File of a module or of a package."""
    module = place.with_suffix(".py")
    return module if module.exists() else place / "__init__.py"


@cache
def own_names(path: Path) -> list[tuple[str, str, Path]]:
    """(module, name, defining file) of each name of the project that a file imports.

    Imports count inside functions and for types, too.
    """
    found = []
    for node, _ in statements(path):
        module = (node.module or "") if isinstance(node, ast.ImportFrom) else ""
        for alias in node.names:
            root, *parts = (module or alias.name).split(".")
            if root != "volspec":
                continue
            place = ROOT.joinpath(*parts)
            names = door(place) if module and place.is_dir() and parts else {}
            inside = file_of(place / alias.name)
            is_module = module and alias.name not in names and inside.exists()
            to = names.get(alias.name, inside if is_module else file_of(place))
            found.append((module or alias.name, alias.name, to))
    return found


def own_imports(path: Path) -> list[Path]:
    """Files of the project that a file imports."""
    return [to for _, _, to in own_names(path)]


def package_of(path: Path) -> str:
    """Package on the project's first level; empty for a module."""
    inside = path.relative_to(ROOT)
    return inside.parts[0] if len(inside.parts) > 1 else ""


def test_imports_across_packages_go_through_their_doors():
    """A package's files are its own: others import what its ``__init__.pyi`` names."""
    past = [
        f"{path.relative_to(ROOT)}: from {module} import {name}"
        for path in MODULES
        for module, name, to in own_names(path)
        if package_of(to) not in ("", package_of(path))
        and name not in door(ROOT.joinpath(*module.split(".")[1:]))
        and not (to.name == "__init__.py" and to.parent.name == name)
    ]
    assert past == []


def test_modules_import_only_from_their_left():
    climbs = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in MODULES
        for module, _ in imports(path)
        if module.startswith("volspec.")
        and LAYERS.index(module.split(".")[1]) > LAYERS.index(layer(path))
    ]
    assert climbs == []


def test_no_package_s_parts_import_each_other_in_a_circle():
    """Parts are a package's files and folders, at every depth; an import counts anywhere."""
    for package in {path.parent for path in MODULES}:
        parts: dict[str, set[str]] = defaultdict(set)
        for path in package.rglob("*.py"):
            part = path.relative_to(package).parts[0]
            inside = (to for to in own_imports(path) if to.is_relative_to(package))
            parts[part] |= {to.relative_to(package).parts[0] for to in inside} - {part}
        try:
            TopologicalSorter(parts).prepare()
        except CycleError as error:
            raise AssertionError(f"{package.relative_to(ROOT)}: {error.args[1]}") from None


# In volspec/viewer: a floor imports only from those before it; app.py knows all.
FLOORS = ("model", "work", "ui")


def test_the_viewer_s_floors_import_only_from_below():
    viewer = ROOT / "viewer"
    climbs = []
    for path in viewer.rglob("*.py"):
        floor = path.relative_to(viewer).parts[0]
        if floor not in FLOORS:
            continue
        for to in own_imports(path):
            above = to.is_relative_to(viewer) and to.relative_to(viewer).parts[0]
            if above and (above not in FLOORS or FLOORS.index(above) > FLOORS.index(floor)):
                climbs.append(f"{path.relative_to(viewer)} imports {to.relative_to(viewer)}")
    assert climbs == []


@pytest.mark.parametrize(
    ("package", "allowed"),
    [
        ("pyopencl", ("_gpu/opencl.py", "_gpu/device_list.py", "_gpu/sharing.py")),
        ("moderngl", ("_gpu/opengl.py", "relight/gpu.py")),
        ("glfw", ("viewer/ui/", "viewer/app.py")),
        ("imgui_bundle", ("viewer/ui/", "viewer/app.py")),
        ("OpenGL", ("viewer/__init__.py", "viewer/ui/window.py", "viewer/work/pictures.py")),
        (
            "pyvista",
            (
                *("volume/model.py", "volume/files/vtk.py", "volume/files/vtk_grid.py"),
                *("raycast/vtk_interop.py", "relight/vtk_interop.py", "_triangles.py"),
                *("mesh/model.py", "mesh/shapes.py", "mesh/pictures.py"),
            ),
        ),
        ("SimpleITK", ("volume/files/",)),
        ("tifffile", ("volume/files/",)),
        ("zarr", ("volume/files/omezarr.py", "volume/files/tensors.py", "large/conversion.py")),
        ("tensorstore", ("volume/files/tensors.py",)),
        ("dask", ("large/cluster.py",)),
        ("distributed", ("large/cluster.py",)),
        ("tornado", ("export/serve/connections.py", "export/serve/http.py")),
        ("OpenEXR", ("_exr.py",)),
        (
            "matplotlib",
            (
                *("_figures.py", "_text.py", "basis/figure.py", "basis/light_figure.py"),
                *("basis/reflectance_figure.py", "palette/figure.py", "relight/difference_maps.py"),
            ),
        ),
    ],
)
def test_machinery_stays_in_its_files(package, allowed):
    users = {
        path.relative_to(ROOT).as_posix()
        for path in ROOT.rglob("*.py")
        if any(module.split(".")[0] == package for module, _ in imports(path))
    }
    assert [user for user in sorted(users) if not user.startswith(allowed)] == []


def test_the_viewer_s_threads_are_in_work():
    for path in (ROOT / "viewer").rglob("*.py"):
        if {"threading", "concurrent.futures"} & {module for module, _ in imports(path)}:
            assert path.relative_to(ROOT / "viewer").parts[0] == "work", path


def test_colour_science_is_used_by_spectra_appearance_references_and_reports_only():
    for path in ROOT.rglob("*.py"):
        if any(module.split(".")[0] == "colour" for module, _ in imports(path)):
            where = path.relative_to(ROOT)
            home = where.parts[0] in ("spectra", "appearance") or where.stem == "reference"
            assert home or where.name == "report.py", where


@pytest.mark.parametrize(
    "heavy",
    [
        *("colour", "pyopencl", "moderngl", "pyvista", "SimpleITK", "OpenEXR", "scipy.optimize"),
        *("tifffile", "zarr", "tensorstore"),
    ],
)
def test_heavy_packages_are_imported_inside_functions(heavy):
    for path in ROOT.rglob("*.py"):
        top = [module for module, at_top in imports(path) if at_top]
        assert not any(m == heavy or m.startswith(heavy + ".") for m in top), path


def test_importing_volspec_loads_no_numpy():
    code = "import sys, volspec; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_stages_on_a_gpu_have_spec_reference_and_launcher():
    for launcher in ROOT.rglob("gpu.py"):
        assert {"spec.py", "reference.py"} <= {path.name for path in launcher.parent.iterdir()}


def test_raycast_and_relight_are_functions_of_the_package():
    """They are subpackages too, whose import must not hide the functions."""
    import volspec
    import volspec.raycast.gpu
    import volspec.relight

    assert callable(volspec.raycast) and callable(volspec.relight)
    for name in volspec.__all__:
        assert getattr(volspec, name) is not None


def test_a_wheel_carries_what_a_checkout_has_beside_the_package():
    """`volspec._gpu.sources` looks in ``_assets``: whatever code asks for must be put there."""
    pyproject = tomllib.loads((ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"))
    included = pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    asked = {
        match
        for path in ROOT.rglob("*.py")
        for match in re.findall(r"[\"'](kernels|shaders|data)/", path.read_text(encoding="utf-8"))
    }
    assert asked == {"kernels", "shaders", "data"}
    assert {source: f"volspec/_assets/{source}" for source in asked} == included


# Modules that required packages bring: those that pyproject.toml does not name.
BROUGHT = {
    "rich": "cyclopts",
    "platformdirs": "pyopencl",
    "annotated_types": "pydantic",
    "pydantic_core": "pydantic",
}
# Programs into which volspec is loaded, or which a name asks for.
HOSTS = {"IPython", "ipywidgets", "traitlets", "vtkmodules", "napari", "xarray"}


def test_every_import_is_required_or_an_extra_s():
    project = tomllib.loads((ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    def names(requirements):
        return {re.split(r"[<>=;\[ ]", each)[0].lower().replace("_", "-") for each in requirements}

    optional = project["optional-dependencies"]
    packages = packages_distributions()
    required = names(project["dependencies"])
    assert {*BROUGHT.values()} <= required
    for extra, modules in EXTRAS.items():
        needs = names(optional[extra])
        for module in modules:
            homes = {each.lower().replace("_", "-") for each in packages[module]}
            assert homes & needs or module in {"aiohttp", "distributed", "imageio_ffmpeg"}, (
                extra,
                module,
            )
    optional_modules = {module for modules in EXTRAS.values() for module in modules}
    for path in ROOT.rglob("*.py"):
        for module in {name.split(".")[0] for name, _ in imports(path)} - sys.stdlib_module_names:
            homes = {module.lower(), *map(str.lower, packages.get(module, []))}
            known = module in {"volspec", *optional_modules, *BROUGHT, *HOSTS} or homes & required
            assert known, f"{path.relative_to(ROOT)} imports {module}"
    assert len(required) <= 18  # what a library and its commands need, and nothing of the window's


def test_a_missing_extra_is_one_line_with_its_command(monkeypatch):
    monkeypatch.setattr(_extras, "find_spec", lambda module: None if module == "pyvista" else 1)
    with pytest.raises(DeviceError) as caught:
        _extras.require_extra("vtk", "a.vti")
    assert str(caught.value) == 'a.vti: pyvista is not installed; pip install "volspec[vtk]"'
    _extras.require_extra("mrc", "a.mrc")
