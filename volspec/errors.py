"""Every exception volspec raises: one hierarchy, so that one ``except`` can catch it.

``VolspecError`` splits in two: what the user gave (`InputError`, exit code 1 of the
command line, one line on stderr) and what the machine lacks (`DeviceError`). A message
says who complains, what it got, what it expected, and the likely remedy.
"""

from __future__ import annotations


class VolspecError(Exception):
    """Base of every exception raised on purpose by this package."""


class VolspecWarning(UserWarning):
    """Base category of every warning issued by this package."""


class InputError(VolspecError, ValueError):
    """Something the user gave cannot be used; the message names it and the remedy."""


class ShapeError(InputError):
    """An array's shape does not fit."""


class VolumeError(InputError):
    """A volume's file, values or geometry cannot be used."""


class SpectrumError(InputError):
    """A light or a reflectance is unknown, malformed or does not cover the grid."""


class BasisError(InputError):
    """A spectral basis cannot be fitted, or does not belong to the data at hand."""


class TransferError(InputError):
    """A transfer function is empty, out of range or names an unknown material."""


class CameraError(InputError):
    """A camera or raycast setting is degenerate."""


class ImageError(InputError):
    """A coefficient image's file is missing, damaged or of another version."""


class ViewingError(InputError):
    """A viewing condition, appearance model or light rig is out of range."""


class SceneError(InputError):
    """A scene file is missing or wrong; the message names the field and its value."""


class DeviceError(VolspecError, RuntimeError):
    """The machine lacks something, or a driver refused."""


class OpenCLError(DeviceError):
    """No OpenCL device, or a kernel did not build; see ``volspec doctor``."""


class OpenGLError(DeviceError):
    """No GL context could be made; see ``volspec doctor``."""
