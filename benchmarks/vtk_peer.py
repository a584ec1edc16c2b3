"""VTK's fixed-point volume mapper on the scene the raycaster gets: same data, camera, step."""

from __future__ import annotations

import os

import numpy as np
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  registers the mappers
from vtkmodules.vtkCommonCore import vtkObject
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
    vtkVolumeProperty,
)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

from volspec.raycast import Camera, RaycastSpec
from volspec.volume import Volume

# A machine without a display is no warning: VTK then draws through EGL.
vtkObject.GlobalWarningDisplayOff()

Points = list[tuple[float, float, tuple[float, float, float]]]


class FixedPointPeer:
    """A VTK scene at its best settings: every core, no automatic coarsening."""

    def __init__(
        self,
        volume: Volume,
        points: Points,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
    ) -> None:
        mapper = vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(volume.to_pyvista())
        mapper.SetAutoAdjustSampleDistances(False)
        mapper.SetLockSampleDistanceToInputSpacing(False)
        mapper.SetImageSampleDistance(1.0)
        mapper.SetSampleDistance(spec.step_of(volume))
        mapper.SetNumberOfThreads(os.cpu_count() or 1)
        self._colour = vtkColorTransferFunction()
        opacity = vtkPiecewiseFunction()
        for value, share, rgb in points:
            opacity.AddPoint(value, share)
            self._colour.AddRGBPoint(value, *rgb)
        self._points = points
        settings = vtkVolumeProperty()
        settings.SetColor(self._colour)
        settings.SetScalarOpacity(opacity)
        settings.SetScalarOpacityUnitDistance(min(volume.spacing_mm))
        settings.SetInterpolationTypeToLinear()
        if spec.shaded:
            settings.ShadeOn()
            settings.SetAmbient(spec.ambient)
            settings.SetDiffuse(spec.diffuse)
            settings.SetSpecular(spec.specular)
            settings.SetSpecularPower(spec.shininess)
        actor = vtkVolume()
        actor.SetMapper(mapper)
        actor.SetProperty(settings)
        renderer = vtkRenderer()
        renderer.AddVolume(actor)
        view = renderer.GetActiveCamera()
        view.SetPosition(*camera.position_mm)
        view.SetFocalPoint(*camera.target_mm)
        view.SetViewUp(*camera.up)
        view.SetViewAngle(camera.fov_deg)
        renderer.ResetCameraClippingRange()
        self._window = vtkRenderWindow()
        self._window.SetOffScreenRendering(True)
        self._window.SetSize(*size)
        self._window.AddRenderer(renderer)
        self._shift = 0.0

    def redraw(self) -> None:
        """Render again as after a change of colours: what a new light costs VTK."""
        self._shift = 0.02 - self._shift
        for value, _, rgb in self._points:
            self._colour.AddRGBPoint(value, *np.clip(np.array(rgb) + self._shift, 0, 1))
        self._window.Render()
        self._window.ReleaseCurrent()

    def picture(self) -> np.ndarray:
        """(H, W, 3) uint8 of the last redraw, the first row on top."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

        grab = vtkWindowToImageFilter()
        grab.SetInput(self._window)
        grab.Update()
        image = grab.GetOutput()
        width, height, _ = image.GetDimensions()
        return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)[::-1]
