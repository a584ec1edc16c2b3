"""A pyvista plotter's volume and view taken over, and relit frames put back."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
import pyvista
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction, vtkPlane
from vtkmodules.vtkIOHDF import vtkHDFWriter
from vtkmodules.vtkIOParallelXML import vtkXMLPImageDataWriter
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkVolumeProperty

import volspec as vs
from tests.support.errors import advised_address, raises, warns
from tests.support.fixtures import slow_each
from volspec.appearance.display import spaces
from volspec.appearance.display.spaces import sRGB_CURVE
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.errors import CameraError, RaycastError, RelightError, TransferError, VolumeError
from volspec.transfer.vtk_interop import transfer_from_vtk
from volspec.volume import volume_choices
from volspec.volume.metadata import NO_UNIT

Plots = Callable[..., pyvista.Plotter]


@pytest.fixture
def plot() -> Iterator[Plots]:
    """Off-screen plotters, closed afterwards."""
    made = []

    def new(**settings: Any) -> pyvista.Plotter:
        made.append(pyvista.Plotter(off_screen=True, **{"window_size": (96, 72), **settings}))
        return made[-1]

    yield new
    for plotter in made:
        plotter.close()


def test_advice_on_a_mesh_makes_a_volume(tmp_path):
    """The Python in the message is run, word for word."""
    ball = pyvista.Sphere(radius=10, theta_resolution=12, phi_resolution=12)
    ball.save(tmp_path / "it's.stl")
    block().cast_to_unstructured_grid().save(tmp_path / "cells.vtu")
    for file, made in (("it's.stl", "it's.vti"), ("cells.vtu", "cells.vti")):
        with raises(VolumeError, "unsupported") as caught:
            vs.load_volume(tmp_path / file)
        exec(caught.value.remedy.partition("Python: ")[2], {"pyvista": pyvista})
        assert vs.load_volume(tmp_path / made).range in ((0, 1), (0, 255))


@pytest.mark.parametrize("suffix", [".vtr", ".vtk"])
@pytest.mark.parametrize("step", [0.5, -0.5])
def test_rectilinear_grids_of_even_spacing_are_volumes(tmp_path, suffix, step):
    planes = np.arange(4) * step + 3, np.arange(3.0), np.arange(5) * 2.0
    grid = pyvista.RectilinearGrid(*planes)
    grid.point_data["v"] = np.arange(60)
    volume = vs.load_volume(saved(grid, tmp_path, f"even{suffix}"))
    assert np.array_equal(volume.values, np.arange(60).reshape(5, 3, 4))
    assert volume.spacing_mm == (0.5, 1, 2)
    assert (volume.world_from_index[0, 0], volume.world_from_index[0, 3]) == (step, 3)


def test_grids_that_are_no_lattice_are_resampled_as_the_message_says(tmp_path):
    structured = shifted().cast_to_structured_grid()
    for grid, file in ((structured, "s.vtk"), (uneven(), "u.vtr")):
        with raises(VolumeError) as caught:
            vs.load_volume(saved(grid, tmp_path, file))
        exec(caught.value.remedy.partition("Python: ")[2], {"pyvista": pyvista})
        assert vs.load_volume(tmp_path / f"{file[0]}-even.vti").shape_xyz == (128, 128, 128)
    with raises(VolumeError, "type") as caught:
        vs.load_volume(saved(pyvista.Sphere(), tmp_path, "ball.vtk"))
    assert "volspec view" in caught.value.remedy


@pytest.mark.parametrize("suffix", [".vti", ".vtr"])
def test_a_spacing_replaces_one_that_is_zero(tmp_path, suffix):
    grid = pyvista.ImageData(dimensions=(6, 5, 4), spacing=(0.5, 0, 2))
    if suffix == ".vtr":
        grid = pyvista.RectilinearGrid(np.arange(6.0), np.zeros(5), np.arange(4) * 2.0)
    grid.point_data["v"] = np.arange(120.0)
    with raises(VolumeError, "range") as caught:
        vs.load_volume(saved(grid, tmp_path, f"v{suffix}"))
    assert vs.load_volume(advised_address(caught.value)).spacing_mm == (1, 1, 1)
    world = vs.load_volume(f"{tmp_path / f'v{suffix}'}?spacing=1,2,3").world_from_index
    assert np.array_equal(np.diag(world), (1, 2, 3, 1))


def shifted() -> pyvista.ImageData:
    """6 × 5 × 4 points with values 0 … 119, whose indices begin at 10, 20, 5."""
    grid = pyvista.ImageData(dimensions=(6, 5, 4), spacing=(0.5, 0.7, 2), origin=(1, 2, 3))
    grid.offset = (10, 20, 5)
    grid.point_data["v"] = np.arange(120.0)
    return grid


@pytest.mark.parametrize("cells", [False, True])
def test_indices_begin_at_those_of_the_extent(tmp_path, cells):
    """A point lies at origin + spacing · index, a cell half a step farther."""
    grid = shifted()
    if cells:
        grid.clear_data()
        grid.cell_data["v"] = np.arange(60.0)
    first = np.array([6, 16, 13]) + cells * np.array(grid.spacing) / 2
    loaded = vs.load_volume(saved(grid, tmp_path, "v.vti"))
    assert loaded.metadata.assumed == (NO_UNIT,)
    for volume in (loaded, vs.Volume.from_pyvista(grid)):
        assert np.allclose(volume.world_from_index[:3, 3], first)


@pytest.mark.parametrize("cells", [False, True])
@pytest.mark.parametrize("hidden", ["point_data", "cell_data"])
def test_hidden_points_and_cells_are_missing(tmp_path, cells, hidden):
    """The lowest layer of points is hidden, or the lowest of cells, and with it what it ends."""
    grid = pyvista.ImageData(dimensions=(6, 5, 4))
    layer, bit = (30, 2) if hidden == "point_data" else (20, 32)
    ghosts = np.zeros(grid.n_points if hidden == "point_data" else grid.n_cells, np.uint8)
    ghosts[:layer] = bit
    getattr(grid, hidden)["vtkGhostType"] = ghosts
    getattr(grid, "cell_data" if cells else "point_data")["v"] = np.arange(60.0 if cells else 120.0)
    with warns("voxels are"):
        volume = vs.Volume.from_pyvista(grid)
    with warns("voxels are"):
        loaded = vs.load_volume(saved(grid, tmp_path, "v.vti"))
    assert np.array_equal(volume.values, loaded.values) and loaded.missing == volume.missing
    assert (volume.values == volume.missing).all(axis=(1, 2)).tolist()[:2] == [True, False]
    assert volume.range[0] == (20.0 if cells else 30.0)
    ghosts[:] = bit
    getattr(grid, hidden)["vtkGhostType"] = ghosts
    with raises(VolumeError, "missing"):
        vs.Volume.from_pyvista(grid)


def test_a_hidden_cell_with_no_hidden_point_is_warned_of():
    grid = shifted()
    grid.cell_data["vtkGhostType"] = np.where(np.arange(60) == 30, 32, 0).astype(np.uint8)
    with warns("1 hidden cells"):
        assert vs.Volume.from_pyvista(grid, "v").missing is None


@pytest.mark.parametrize("suffix", [".vti", ".vtk"])
def test_components_are_channels_next_to_other_arrays(tmp_path, suffix):
    grid = shifted()
    grid.point_data["w"] = np.arange(360.0, dtype="f4").reshape(120, 3)
    fields = [*vs.load_volume(saved(grid, tmp_path, f"v{suffix}")).by_role.values()]
    assert [field.channel.name for field in fields] == ["v", "w 0", "w 1", "w 2"]
    assert np.array_equal(fields[2].values.ravel(), np.arange(1, 360, 3))


def in_parts(grid: pyvista.ImageData, folder: Path, name: str) -> Path:
    """A file of a block, or of two pieces, or HDF5."""
    if name.endswith(".vtm"):
        return saved(pyvista.MultiBlock([grid]), folder, name)
    writer: Any = vtkHDFWriter()
    if name.endswith(".pvti"):
        writer = vtkXMLPImageDataWriter()
        writer.SetNumberOfPieces(2)
        writer.SetEndPiece(1)
    writer.SetInputData(grid)
    writer.SetFileName(str(folder / name))
    writer.Write()
    return folder / name


@pytest.mark.parametrize("name", ["v.pvti", "v.vtkhdf", "v.vtm"])
def test_pieces_blocks_and_hdf5_are_the_grid_that_was_saved(tmp_path, name):
    volume = vs.load_volume(in_parts(shifted(), tmp_path, name))
    assert np.array_equal(volume.values.ravel(), np.arange(120))
    assert np.allclose(volume.world_from_index[:3, 3], (6, 16, 13))


def test_parts_are_chosen_and_missing_ones_named(tmp_path):
    blocks = pyvista.MultiBlock({"ct": shifted(), "mr": even(), "ball": pyvista.Sphere()})
    path = saved(blocks, tmp_path, "v.vtm")
    (choice,) = volume_choices(path)
    assert (choice.key, choice.values) == ("dataset", ("mr", "ct"))
    assert vs.load_volume(f"{path}?dataset=ct").shape_xyz == (6, 5, 4)
    for part, whole in (("v_1.vti", in_parts(shifted(), tmp_path, "v.pvti")), ("v/v_0.vti", path)):
        (tmp_path / part).unlink()
        with raises(VolumeError, "not-found") as caught:
            vs.load_volume(whole)
        assert Path(part).name in str(caught.value)


def uneven() -> pyvista.RectilinearGrid:
    places = np.array([0.0, 1, 3, 4]), np.arange(3.0), np.arange(5.0)
    grid = pyvista.RectilinearGrid(*(1e-9 * each for each in places))
    grid.point_data["v"] = np.arange(60)
    return grid


def block() -> pyvista.ImageData:
    """An L of different arms, which no turn or mirror maps onto itself: 255 in it, 0 around."""
    values = np.zeros((20, 22, 24), np.float32)
    values[3:9, 3:19, 3:9] = 255
    values[3:9, 3:9, 3:21] = 255
    values[3:17, 3:6, 3:6] = 255
    return vs.Volume(values, spacing_mm=(1.0, 1.2, 0.8)).to_pyvista()


def even(value: float = 0.5, count: int = 12) -> pyvista.ImageData:
    """One value everywhere but in two corners, which span 0 to 1."""
    values = np.full((count, count, count), value, np.float32)
    values[0, 0, 0], values[-1, -1, -1] = 0.0, 1.0
    return vs.Volume(values).to_pyvista()


def projected(camera: Camera, size: tuple[int, int], points: np.ndarray) -> np.ndarray:
    """Pixels (x, y) of world points, row 0 on top; from what the camera says of its rays."""
    rays = camera.ray_field(*size)
    at = points - camera.position_mm
    if rays.perspective:
        at = at * (rays.distance / (at @ rays.forward))[:, None]
    at = at + np.asarray(camera.position_mm) - rays.target
    x, y = (at @ axis / (axis @ axis) for axis in (rays.across, rays.down))
    return np.stack([x + rays.middle[0], y + rays.middle[1]], axis=1)


def displayed(renderer: Any, size: tuple[int, int], points: np.ndarray) -> np.ndarray:
    """Pixels by VTK, which counts from the window's lower left edge."""
    left, low, *_ = renderer.GetViewport()
    window = np.array(renderer.GetRenderWindow().GetSize())
    found = []
    for point in points:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        found.append(renderer.GetDisplayPoint()[:2])
    at = np.array(found) - window * (left, low)
    return np.stack([at[:, 0] - 0.5, size[1] - at[:, 1] - 0.5], axis=1)


def perspective(plotter: pyvista.Plotter) -> None:
    plotter.camera_position = [(60, -40, 35), (11, 10, 7), (0.2, 0.1, 1)]
    plotter.camera.view_angle = 44


def parallel(plotter: pyvista.Plotter) -> None:
    perspective(plotter)
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 19


def horizontal(plotter: pyvista.Plotter) -> None:
    perspective(plotter)
    plotter.camera.SetUseHorizontalViewAngle(True)


def rolled(plotter: pyvista.Plotter) -> None:
    perspective(plotter)
    plotter.camera.roll += 35
    plotter.camera.zoom(1.3)


def untouched(_: pyvista.Plotter) -> None:
    """Leave the view with which the plotter opens."""


@pytest.mark.parametrize("view", [untouched, perspective, parallel, horizontal, rolled])
def test_points_fall_on_the_same_pixels(plot, view):
    plotter = plot(shape=(1, 2))
    plotter.subplot(0, 1)
    plotter.add_volume(block(), show_scalar_bar=False)
    view(plotter)
    taken = vs.from_plotter(plotter)
    assert taken.size == (48, 72)
    assert taken.volume.name == "ImageData"  # and no address in memory, which notes would have
    points = np.random.default_rng(3).uniform((0, 0, 0), (23, 25, 15), (40, 3))
    theirs = displayed(plotter.renderer, taken.size, points)
    # Both in float64; VTK rounds where it multiplies its two matrices.
    assert np.abs(projected(taken.camera, taken.size, points) - theirs).max() < 1e-6


def test_a_plotter_not_yet_shown_has_the_view_it_opens_with(plot):
    first, second = plot(), plot()
    for plotter in (first, second):
        plotter.add_volume(block(), reset_camera=False, show_scalar_bar=False)
    assert not first.renderer.camera.is_set
    second.screenshot()
    assert vs.from_plotter(first).camera == vs.from_plotter(second).camera


@pytest.mark.parametrize("view", [perspective, *slow_each(parallel)])
def test_silhouettes_cover_vtks(plot, view):
    """Turned, moved and stretched by matrix and plotter. You should see one L, not two."""
    plotter = plot(window_size=(240, 180))
    matrix = pyvista.Transform().scale(1.4).rotate_z(30).rotate_x(20).translate(2, -3, 1).matrix
    actor = plotter.add_volume(
        block(), opacity=[0.0, 0.8], cmap="gray", user_matrix=matrix, show_scalar_bar=False
    )
    actor.prop.interpolation_type = "linear"
    plotter.set_scale(0.9, 0.9, 0.9)
    view(plotter)
    plotter.reset_camera_clipping_range()
    image = vs.raycast(*vs.from_plotter(plotter))
    picture = plotter.screenshot(transparent_background=True)
    theirs, ours = picture[..., 3] > 128, image.alpha > 0.5
    assert ours.mean() > 0.05
    # Measured 0.999; the steps of the two begin elsewhere along a ray.
    assert (theirs & ours).sum() / (theirs | ours).sum() > 0.99


@pytest.mark.parametrize("stretch", [2.0, *slow_each(1.0)])
def test_opacities_are_vtks(plot, stretch):
    """1 − 0.7^(11 / 5), stretched or not: unit distances are the grid's."""
    plotter = plot(window_size=(32, 32))
    plotter.add_volume(even(), opacity=[0.3, 0.3], opacity_unit_distance=5.0, show_scalar_bar=False)
    plotter.set_scale(stretch, stretch, stretch)
    plotter.view_xy()
    plotter.enable_parallel_projection()
    plotter.camera.zoom(2)
    image = vs.raycast(*vs.from_plotter(plotter))
    theirs = plotter.screenshot(transparent_background=True)[16, 16, 3] / 255
    # pyvista keeps opacities in steps of 1/255: 0.298 for 0.3.
    assert image.alpha[16, 16] == pytest.approx(1 - (1 - 76 / 255) ** (11 / 5), abs=1e-3)
    # VTK's own steps do not end with the volume.
    assert image.alpha[16, 16] == pytest.approx(theirs, abs=0.02)


def test_opaque_colours_are_vtks_under_daylight(plot):
    plotter = plot(window_size=(32, 32))
    plotter.add_volume(even(0.7), cmap="viridis", opacity=[1.0, 1.0], show_scalar_bar=False)
    plotter.view_xy()
    image = vs.raycast(*vs.from_plotter(plotter))
    plain = vs.RelightSpec(vs.Viewing(model="none"), backdrop=0.0)
    frame = vs.relight(image, vs.light("D65"), plain)
    theirs = plotter.screenshot(return_img=True)[16, 16, :3].astype(int)
    # Two codes between materials, one from the basis, one of the rest of opacity, 0.998.
    assert np.abs(frame[16, 16] - theirs).max() <= 4


def colour_of(mix: dict[str, float], materials: dict[str, vs.Spectrum]) -> np.ndarray:
    """sRGB codes of a mix under D65."""
    basis = SpectralBasis.bands()
    channels = basis.channels_for_materials({name: materials[name] for name in mix})
    XYZ = basis.colour_matrix(vs.light("D65"), "exact") @ (list(mix.values()) @ channels)
    return np.asarray(255 * sRGB_CURVE.encode(spaces.sRGB_FROM_XYZ @ XYZ))


def piecewise(*points: tuple[float, ...]) -> vtkPiecewiseFunction:
    function = vtkPiecewiseFunction()
    for point in points:
        function.AddPoint(*point)
    return function


def test_curves_that_bend_between_vtks_points_are_followed():
    """Sharp and soft opacity, hues around the circle."""
    opacity = piecewise((-10, 0.0, 0.3, 0.6), (30, 0.9, 0.5, 1.0), (80, 0.2))
    colours = vtkColorTransferFunction()
    colours.SetColorSpaceToHSV()
    colours.AddRGBPoint(-10, 0.7, 0.2, 0.2)
    colours.AddRGBPoint(80, 0.2, 0.2, 0.7)
    settings = vtkVolumeProperty()
    settings.SetScalarOpacity(opacity)
    settings.SetColor(colours)
    settings.SetScalarOpacityUnitDistance(2.5)
    transfer = transfer_from_vtk(settings, unit_scale=2.0)
    assert transfer.reference_step_mm == 5.0
    values = [value for value, _, _ in transfer.points]
    at = np.linspace(-10, 80, 91)
    ours = np.interp(at, values, [share for _, share, _ in transfer.points])
    # Looked at 256 times: a bend of VTK's, at most 0.02 high here, may lie between two.
    assert np.abs(ours - [opacity.GetValue(value) for value in at]).max() < 0.02
    for value, _, mix in transfer.points[::10]:
        wanted = 255 * np.array(colours.GetColor(value))
        assert np.abs(colour_of(mix, transfer.materials) - wanted).max() < 3


def test_grey_curves_become_greys():
    settings = vtkVolumeProperty()
    settings.SetScalarOpacity(piecewise((0, 0.0), (100, 1.0)))
    settings.SetColor(piecewise((0, 0.2), (100, 0.8)))
    materials = transfer_from_vtk(settings).materials
    assert {"#333333", "#cccccc"} <= set(materials)
    assert all(re.fullmatch(r"#(..)\1\1", name) for name in materials)


def test_blending_shading_and_clip_planes_are_taken_over(plot):
    plotter = plot()
    weights = {"ambient": 0.2, "diffuse": 0.5, "specular": 0.1}
    lit = plotter.add_volume(block(), name="lit", shade=True, specular_power=20, **weights)
    plane = vtkPlane()
    plane.SetOrigin(4, 0, 0)
    plane.SetNormal(1, 0, 0)
    lit.mapper.AddClippingPlane(plane)
    plotter.add_volume(block(), name="greatest", blending="maximum", shade=True)
    spec = vs.from_plotter(plotter, "lit").spec
    assert {name: getattr(spec, name) for name in weights} == weights
    assert (spec.shininess, spec.mode) == (20, "composite")
    (taken,) = spec.clip_planes
    assert (taken.point_mm, taken.normal) == ((4, 0, 0), (1, 0, 0))
    spec = vs.from_plotter(plotter, "greatest").spec
    assert (spec.mode, spec.ambient, spec.diffuse) == ("maximum", 1.0, 0.0)
    plotter.add_volume(block(), name="mean", blending="average")
    with warns("mean", "'average'"):
        assert vs.from_plotter(plotter, "mean").spec.mode == "average"


def two_volumes(plotter: pyvista.Plotter) -> pyvista.Plotter:
    plotter.add_mesh(pyvista.Sphere(), name="ball")
    plotter.add_volume(pyvista.MultiBlock([block(), even()]), name="ct")
    return plotter


def test_missing_voxels_of_a_plotter_stay_missing(plot):
    grid, plotter = even(), plot()
    grid.point_data["vtkGhostType"] = np.where(np.arange(grid.n_points) < 3, 2, 0).astype(np.uint8)
    grid.set_active_scalars("values")
    plotter.add_volume(grid, show_scalar_bar=False)
    with warns("3 of 1728 voxels"):
        volume = vs.from_plotter(plotter).volume
    assert volume.range == (0.5, 1.0) and np.count_nonzero(volume.values == volume.missing) == 3


def test_one_of_several_volumes_is_taken_by_its_name(plot):
    plotter = two_volumes(plot())
    assert vs.from_plotter(plotter, "ct-1").volume.shape_xyz == (12, 12, 12)
    plotter.actors["ct-1"].SetVisibility(False)
    assert vs.from_plotter(plotter).volume.name == "ct-0"


def coloured() -> pyvista.ImageData:
    grid = pyvista.ImageData(dimensions=(3, 3, 3))
    grid["rgba"] = np.full((27, 4), 99, np.uint8)
    return grid


def closed(plotter: pyvista.Plotter) -> pyvista.Plotter:
    plotter.close()
    return plotter


def take(grid: Any, change: Callable[[Any, Any], object] = lambda _, __: None, **how: Any) -> Any:
    """A row's call: take a grid over from a plotter, changed with its actor."""

    def call(plotter: pyvista.Plotter, _: Path) -> None:
        change(plotter, plotter.add_volume(grid, name="ct", **how))
        vs.from_plotter(plotter)

    return call


def flatten(_: pyvista.Plotter, actor: Any) -> None:
    actor.user_matrix = np.diag([1.0, 1.0, 0.0, 1.0])


def saved(grid: Any, folder: Path, name: str) -> Path:
    grid.save(folder / name)
    return folder / name


BARE = pyvista.ImageData(dimensions=(3, 3, 3))
BALLS = pyvista.MultiBlock([pyvista.Sphere()])
NO_FRAMES = [
    *(np.zeros((4, 4)), np.zeros((4, 4, 3)), np.zeros((4, 4, 4), "u1")),
    *(np.zeros((0, 4, 3), "u1"), np.full((4, 4, 3), np.nan, "f4")),
]
REFUSED: list[
    tuple[Callable[[pyvista.Plotter, Path], object], type[vs.VolspecError], str | None]
] = [
    # What has no counterpart here.
    (take(block(), blending="additive"), RaycastError, "unsupported"),
    (take(coloured()), VolumeError, "shape"),
    (take(uneven()), VolumeError, "unsupported"),
    (
        take(block(), lambda _, a: a.prop.SetTransferFunctionModeTo2D()),
        TransferError,
        "unsupported",
    ),
    (take(block(), opacity_unit_distance=0), TransferError, "range"),
    (take(block(), flatten), VolumeError, "range"),
    (take(block(), lambda p, _: p.camera.SetWindowCenter(0.2, 0)), CameraError, "unsupported"),
    (lambda _, to: vs.load_volume(saved(uneven(), to, "v.vtr")), VolumeError, "unsupported"),
    (lambda _, to: vs.load_volume(saved(uneven(), to, "v.vtk")), VolumeError, "unsupported"),
    (lambda _, to: vs.load_volume(saved(BARE, to, "v.vti")), VolumeError, "shape"),
    (lambda _, to: vs.load_volume(saved(BALLS, to, "v.vtm")), VolumeError, "unsupported"),
    # No volume, several, another name, a plotter that is closed or none.
    (lambda p, _: vs.from_plotter(p), RaycastError, "missing"),
    (lambda p, _: vs.from_plotter(two_volumes(p)), RaycastError, "missing"),
    (lambda p, _: vs.from_plotter(two_volumes(p), "ball"), RaycastError, "unknown"),
    (lambda p, _: vs.from_plotter(two_volumes(p), ["ball"]), RaycastError, "unknown"),
    (lambda p, _: vs.from_plotter(closed(p)), RaycastError, "state"),
    (lambda p, _: vs.picture_plane(closed(p)), RaycastError, "state"),
    (lambda _, __: vs.from_plotter(block()), RaycastError, "type"),
    (lambda _, __: vs.picture_plane(block()), RaycastError, "type"),
    (lambda p, _: vs.picture_plane(p, 0), RaycastError, None),
    *((lambda _, __, frame=frame: vs.to_texture(frame), RelightError, None) for frame in NO_FRAMES),
]


@pytest.mark.parametrize(("call", "error", "code"), REFUSED)
def test_what_has_no_counterpart_is_refused(plot, tmp_path, call, error, code):
    with raises(error, code):
        call(plot(), tmp_path)


def test_unsupported_settings_cause_a_warning(plot):
    plotter = plot()
    actor = plotter.add_volume(block(), name="ct")
    actor.prop.SetGradientOpacity(piecewise((0, 0.0), (1, 1.0)))
    actor.mapper.SetCropping(True)
    plotter.set_scale(zscale=3)
    with warns("ct", "gradient", "cropping", " 3 ", file=__file__):
        volume = vs.from_plotter(plotter).volume
    assert np.allclose(volume.spacing_mm, (1.0, 1.2, 2.4))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_frame_comes_back_pixel_on_pixel(plot, dtype):
    """The view is stretched and tilted; a ball nearer than the frame stays in front of it."""
    plotter = plot()
    plotter.set_scale(1, 1, 2)
    plotter.disable_anti_aliasing()
    perspective(plotter)
    frame = np.random.default_rng(5).integers(0, 256, (72, 96, 3)).astype(np.uint8)
    texture = vs.to_texture(frame if dtype is np.uint8 else frame.astype(dtype) / dtype(255))
    plotter.add_mesh(vs.picture_plane(plotter), texture=texture, lighting=False)
    assert np.array_equal(plotter.screenshot(return_img=True)[..., :3], frame)
    nearer = np.array([42.0, -27, 13])  # half-way, before the stretch
    plotter.add_mesh(pyvista.Sphere(radius=2, center=nearer), color="red", lighting=False)
    plotter.add_mesh(pyvista.Sphere(radius=2, center=(2, 25, -3)), color="blue", lighting=False)
    picture = plotter.screenshot(return_img=True)[..., :3]
    changed = (picture != frame).any(axis=-1)
    assert changed.any() and (picture[changed] == (255, 0, 0)).all()


def test_a_plane_farther_away_looks_the_same(plot):
    plotter = plot()
    for view, grows in ((perspective, 2.5), (parallel, 1.0)):
        view(plotter)
        near, far = (vs.picture_plane(plotter, distance).length for distance in (10.0, 25.0))
        assert far == pytest.approx(grows * near, rel=1e-5)  # points are float32


@pytest.mark.slow
def test_the_guides_example_shows_what_it_says(tmp_path, monkeypatch):
    """You should see one engine three times at the same pixels, green by day, blue by HP1."""
    text = (Path(__file__).resolve().parents[2] / "docs/pyvista.md").read_text(encoding="utf-8")
    # In the page's order; fewer voxels and pixels: VTK takes seconds over all of them on a CPU.
    code = "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[:2])
    quick = code.replace('("engine")', '("engine").downsampled(2)').replace("400", "200")
    assert quick.count("downsampled") == 1 and "dataclasses" in quick
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(quick, found)
    found["plotter"].close()
    pictures = (iio.imread(f"{name}.png") for name in ("vtk", "D65", "HP1"))
    vtk, day, lamp = (picture[..., :3].astype(int) for picture in pictures)
    theirs, ours = (vtk < 200).any(axis=-1), found["image"].alpha > 0.5
    # VTK's edges, found by colour on white, are a pixel wider.
    assert (theirs & ours).sum() / (theirs | ours).sum() > 0.95
    green, blue = (picture[ours].mean(axis=0) for picture in (day, lamp))
    assert green[1] > green[2] + 10 and blue[1] < blue[2] - 5
