"""What is drawn over the picture and beside it: frozen, a part of the window's state."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Aids:
    """What stands over the picture.

    Parameters
    ----------
    cube, scale : bool
        The orientation cube and the scale bar.
    crop, planes : bool
        The crop's box and the clip planes, with handles; they cut whether seen or not.
    plane : int
        The clip plane that stands out.
    outlines : bool
        Where the slices lie.
    patient : bool, optional
        Whether directions are named by the patient's body; None where the volume says.
    """

    cube: bool = True
    scale: bool = True
    crop: bool = False
    planes: bool = True
    plane: int = 0
    outlines: bool = True
    patient: bool | None = None


@dataclass(frozen=True, slots=True)
class Slices:
    """Where the slices lie and how they are shown.

    Parameters
    ----------
    at : (x, y, z)
        Along each axis of the voxels, 0 to 1 of the volume.
    lit : bool
        Shown with the transfer function's materials under the lights; else as greys.
    greys : (low, high), optional
        Values shown black and white, 0 to 1 of the volume's range; None where most values lie.
    """

    at: tuple[float, float, float] = (0.5, 0.5, 0.5)
    lit: bool = True
    greys: tuple[float, float] | None = None
