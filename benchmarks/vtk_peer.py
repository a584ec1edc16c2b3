"""VTK's volume mappers on the raycaster's scene: same data, camera, points, step."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  registers the mappers
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkObject
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import (
    vtkAbstractVolumeMapper,
    vtkCamera,
    vtkColorTransferFunction,
    vtkLight,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
    vtkVolumeProperty,
    vtkWindowToImageFilter,
)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper
from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

from volspec.camera import Camera
from volspec.raycast import RaycastSpec
from volspec.volume import Volume

# No warning about a missing display: VTK then draws through EGL.
vtkObject.GlobalWarningDisplayOff()

Points = Sequence[tuple[float, float, tuple[float, float, float]]]
# Transmittance at which the fixed-point mapper ends a ray: 0xff of 0x7fff.
ALPHA_STOP = 1 - 0xFF / 0x7FFF


class VtkPeer:
    """A VTK scene: one headlight, two-sided lighting, black behind.

    Parameters
    ----------
    points : of (value, opacity per reference step, RGB)
    reference_step_mm : float
    """

    def __init__(
        self,
        mapper: vtkAbstractVolumeMapper,
        volume: Volume,
        points: Points,
        reference_step_mm: float,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
    ) -> None:
        mapper.SetInputData(volume.to_pyvista())
        self._points = points
        self._colour = vtkColorTransferFunction()
        actor = vtkVolume()
        actor.SetMapper(mapper)
        actor.SetProperty(self._property(spec, reference_step_mm))
        renderer = vtkRenderer()
        renderer.AddVolume(actor)
        renderer.SetAutomaticLightCreation(False)
        renderer.SetTwoSidedLighting(True)
        light = vtkLight()
        light.SetLightTypeToHeadlight()
        light.SetAmbientColor(1, 1, 1)  # else the fixed-point mapper leaves ambient light out
        renderer.AddLight(light)
        place(renderer.GetActiveCamera(), camera)
        renderer.ResetCameraClippingRange()
        self._window = vtkRenderWindow()
        self._window.SetOffScreenRendering(True)
        self._window.SetMultiSamples(0)
        self._window.SetSize(*size)
        self._window.AddRenderer(renderer)
        self._shift = 0.0

    def _property(self, spec: RaycastSpec, reference_step_mm: float) -> vtkVolumeProperty:
        opacity = vtkPiecewiseFunction()
        for value, share, rgb in self._points:
            opacity.AddPoint(value, share)
            self._colour.AddRGBPoint(value, *rgb)
        settings = vtkVolumeProperty()
        settings.SetColor(self._colour)
        settings.SetScalarOpacity(opacity)
        settings.SetScalarOpacityUnitDistance(reference_step_mm)
        settings.SetInterpolationTypeToLinear()
        if spec.shaded:
            settings.ShadeOn()
            settings.SetAmbient(spec.ambient)
            settings.SetDiffuse(spec.diffuse)
            settings.SetSpecular(spec.specular)
            settings.SetSpecularPower(spec.shininess)
        return settings

    def redraw(self) -> None:
        """Render again as after a change of colours: the cost of a new light in VTK."""
        self._shift = 0.02 - self._shift
        for value, _, rgb in self._points:
            self._colour.AddRGBPoint(value, *np.clip(np.array(rgb) + self._shift, 0, 1))
        self.draw()

    def draw(self) -> None:
        """Render, and wait for the last pixel."""
        self._window.Render()
        self._window.WaitForCompletion()
        self._window.ReleaseCurrent()

    def picture(self) -> NDArray[np.uint8]:
        """Return (H, W, 3) uint8 of the last redraw, first row at the top."""
        grab = vtkWindowToImageFilter()
        grab.SetInput(self._window)
        grab.ShouldRerenderOff()
        grab.Update()
        image = grab.GetOutput()
        width, height, _ = image.GetDimensions()
        values = vtk_to_numpy(image.GetPointData().GetScalars())
        self._window.ReleaseCurrent()
        return values.reshape(height, width, -1)[::-1]


def place(view: vtkCamera, camera: Camera) -> None:
    """Place VTK's camera like ours."""
    view.SetPosition(*camera.position_mm)
    view.SetFocalPoint(*camera.target_mm)
    view.SetViewUp(*camera.up)
    view.SetViewAngle(camera.fov_deg)
    if camera.height_mm is not None:
        view.ParallelProjectionOn()
        view.SetParallelScale(camera.height_mm / 2)


def fixed_point(
    volume: Volume,
    points: Points,
    reference_step_mm: float,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
) -> VtkPeer:
    """Return the fixed-point mapper at its best settings: all cores, no automatic coarsening."""
    mapper = vtkFixedPointVolumeRayCastMapper()
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetLockSampleDistanceToInputSpacing(False)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(spec.step_of(volume))
    mapper.SetIntermixIntersectingGeometry(False)
    mapper.SetNumberOfThreads(os.cpu_count() or 1)
    return VtkPeer(mapper, volume, points, reference_step_mm, camera, size, spec)


def gpu_mapper(
    volume: Volume,
    points: Points,
    reference_step_mm: float,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
) -> VtkPeer:
    """Return the OpenGL mapper, without coarsening or jitter; on llvmpipe if there is no GPU."""
    mapper = vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetLockSampleDistanceToInputSpacing(False)
    mapper.SetUseJittering(False)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(spec.step_of(volume))
    return VtkPeer(mapper, volume, points, reference_step_mm, camera, size, spec)
