"""Documents of coefficient images: one view of fixed materials, under any light.

    IMAGE.exr -> [cast_images] -> Document

The panels of a document need a volume and a transfer function. An image gets a ball for the former,
which is never cast, and its basis and materials as the latter.
"""

from __future__ import annotations

from dataclasses import replace

from volspec.basis import Basis, MaterialBasis
from volspec.image import CoefficientImage
from volspec.raycast import Ambient, LightGroup
from volspec.scene import Scene, stored_look
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model.document import Document
from volspec.volume import Volume, phantom

SUFFIX = ".exr"
_BALL = 8  # voxels a side


def is_cast_image(path: str) -> bool:
    """Return True if a path is that of a coefficient image, by its ending."""
    return path.lower().endswith(SUFFIX)


def image_volume() -> Volume:
    """Return the volume that takes the place of the one that was cast."""
    return phantom.ball(_BALL)


def open_image(path: str) -> Document:
    """Open a coefficient image, under the viewing conditions of its scene.

    Raises ImageError if it cannot be read, or is another kind of picture.
    """
    image, volume = CoefficientImage.load(path), image_volume()
    document = Document.of(Scene.from_volume(path, volume=volume), volume, None)
    look = stored_look(image)
    groups = tuple(LightGroup(name, (Ambient(),)) for name in image.groups)
    return replace(
        document,
        image=image,
        transfer=_transfer(image.basis),
        shading=replace(document.shading, groups=groups),
        relight=look.relight,
        depth=look.depth,
    )


def _transfer(basis: Basis) -> TransferFunction:
    """Return a transfer function with an image's materials, which may be edited if known."""
    reflectances = basis.materials if isinstance(basis, MaterialBasis) else {}
    materials = dict(reflectances) or {"cast": reflectance("grey:0.5", basis.grid)}
    points = [(i / len(materials), 1.0, name) for i, name in enumerate(materials)]
    return TransferFunction([*points, (1.0, 1.0, points[-1][2])], materials, basis)
