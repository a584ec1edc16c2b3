"""A look: everything that follows a cast, as one value.

coefficient image -> [look] -> its picture, or one for each eye -> relight -> frame
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from numpy.typing import NDArray

from volspec._gpu import Compute
from volspec.appearance import Viewing
from volspec.appearance.display import Hdr
from volspec.basis import MaterialBasis
from volspec.errors import ImageError
from volspec.image import CoefficientImage, DepthEffects
from volspec.relight.spec import RelightSpec
from volspec.relight.stereo import Stereo, StereoViews
from volspec.spectra import Spectrum

# One object, as specs are compared by identity.
_PLAIN = RelightSpec()


@dataclass(frozen=True, slots=True)
class Look:
    """Settings of the pictures of one cast: materials, depth, eyes, viewing and display.

    Raises ImageError if ``stereo`` is set together with ``hdr`` or a focus.
    """

    relight: RelightSpec = _PLAIN
    """Viewing, mode, backdrop and level."""
    reflectances: Mapping[str, Spectrum] = field(default_factory=dict)
    """Reflectances of some materials, as of `CoefficientImage.with_reflectances`."""
    opacities: Mapping[str, float] = field(default_factory=dict)
    """Scales of materials' optical depths, as of `CoefficientImage.recompose`."""
    depth: DepthEffects = field(default_factory=DepthEffects)
    """Focus, fog and cuts."""
    stereo: Stereo | None = None
    """Both eyes; one picture if left out."""
    hdr: Hdr | None = None
    """Display of high dynamic range; the viewing's display if left out."""

    def __post_init__(self) -> None:
        settings = {"hdr": self.hdr, "focus_mm": self.depth.focus_mm}
        self._without_stereo({name: value for name, value in settings.items() if value is not None})

    def _without_stereo(self, settings: Mapping[str, object]) -> None:
        if self.stereo is not None and settings:
            name, problem = next(iter(settings)), "does not work with stereo"
            raise ImageError(problem, "leave one out", code="conflict", field=name)

    @classmethod
    def of(cls, look: Look | RelightSpec | Viewing | None) -> Look:
        """Return settings as a look; a `RelightSpec` leaves the others at their defaults."""
        return look if isinstance(look, Look) else cls(RelightSpec.of(look))

    def fitting(self, image: CoefficientImage) -> Look:
        """Return the look without what an image cannot have: other materials, and depth."""
        materials = image.basis.materials if isinstance(image.basis, MaterialBasis) else {}
        layered = image.opacity_layers is not None
        return replace(
            self,
            reflectances={k: v for k, v in self.reflectances.items() if k in materials},
            opacities={k: v for k, v in self.opacities.items() if k in materials and layered},
            depth=self.depth if layered else DepthEffects(),
            stereo=self.stereo if layered else None,
        )

    def views(
        self,
        image: CoefficientImage,
        surface: CoefficientImage | None = None,
        compute: Compute | None = None,
    ) -> tuple[CoefficientImage, ...]:
        """Return the image in this look, or what the left and the right eye see of it.

        The views have no layers. Their frames, under the look `of_view`, are joined by `combine`.
        ``surface`` is opaque, at its depth, and not for two eyes; ``compute`` is an open OpenCL
        device. Raises as `CoefficientImage.with_reflectances` and `recompose`, and `Reprojector`.
        """
        if self.reflectances:
            image = image.with_reflectances(self.reflectances)
        if self.stereo is not None:
            self._without_stereo({} if surface is None else {"surface": surface})
            return StereoViews(image, compute).views(self.stereo, self.opacities, self.depth)
        settings = image.opacity_layers, surface, self.opacities or None
        if self.depth.changes or any(setting is not None for setting in settings):
            image = image.recompose(self.opacities, self.depth, surface)
        return (image,)

    @property
    def of_view(self) -> Look:
        """Look of one of the `views`: viewing and display alone."""
        return Look(self.relight, hdr=self.hdr)

    def combine(self, frames: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Return the frames of the `views` as one: display codes (H, W, 3)."""
        if self.stereo is None:
            return frames[0]
        left, right = frames
        return self.stereo.combine(left, right, self.relight.viewing.display.space)
