"""A passage that changes over the picture: eyes that adapt to what lies around each pixel.

    Viewing, white, (Y_b, L_A) on a net -> [field] -> host | shaders/include/cam.glsl

Of CIECAM02's and CAM16's passage only the scene's side changes with Y_b and L_A: the matrix to
linear responses, w, γ and κ, twelve numbers. They are worked out at the nodes of a net that spans
the picture from edge to edge, and are interpolated, each by itself, straight between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import constants as k
from volspec.appearance.models import level
from volspec.appearance.models.conditions import CamPassage, Conditions, compress
from volspec.appearance.net import between
from volspec.appearance.spec import Viewing

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PassageField:
    """`CamPassage`s on a net over a picture.

    Parameters
    ----------
    passage : CamPassage
        Of one node: the display's side, which is the same in all.
    numbers : (R, C, 12) float64
        Of each node, in the order of the texture's layers: a column of the scene's
        ``response_from_XYZ`` and, fourth, ``scene_achromatic``, ``lightness_power`` and
        ``chroma_gain``.
    """

    passage: CamPassage
    numbers: Array

    @classmethod
    def of(cls, viewing: Viewing, white_XYZ: Array, Y_b: Array, L_A: Array) -> PassageField:
        """The passages of an eye that is adapted to something else at each node.

        Parameters
        ----------
        viewing : Viewing
            Of model CIECAM02 or CAM16; its Y_b and L_A are not looked at.
        white_XYZ : (3,)
            The scene's adopted white.
        Y_b, L_A : (R, C)
            Background, percent of the white; adapting luminance, cd/m².

        Raises
        ------
        ViewingError
            If the white has no lightness in the model at some node.
        """
        model, L_A, Y_b = viewing.model, np.asarray(L_A), np.asarray(Y_b)
        given = replace(viewing, adapting="given")
        whole = Conditions.of_viewing(
            replace(given, D=1.0, discount=False, L_A=0.0).conditions(white_XYZ), model
        )
        factors, white = whole.surround, np.array(whole.white_XYZ)
        F_L, n = level.level_factor(L_A), level.background_ratio(Y_b, white[1])
        if viewing.discount:
            D = np.ones_like(F_L)
        elif viewing.D is not None:
            D = np.full_like(F_L, viewing.D)
        else:
            D = level.degree_of_adaptation(factors.F, L_A)
        # The gains, and so the matrix, are linear in D.
        wholly = replace(whole, F_L=1.0).response_from_XYZ()
        not_at_all = replace(whole, F_L=1.0, D_RGB=(1.0, 1.0, 1.0)).response_from_XYZ()
        matrix = not_at_all + D[..., None, None] * (wholly - not_at_all)
        matrix *= F_L[..., None, None]
        achromatic = compress(matrix @ white) @ k.ACHROMATIC
        # Of all nodes that with the least lightness of white: it is refused if any is.
        node = np.unravel_index(int(np.argmin(achromatic)), achromatic.shape)
        least = replace(given, L_A=float(L_A[node]), Y_b=float(Y_b[node]))
        passage = CamPassage.seen_by(model, least.conditions(white_XYZ), viewing.display.conditions)
        display = passage.display
        power = factors.c * level.lightness_exponent(n) / display.lightness_power
        scale = level.chroma_scale(n) / display.chroma_scale
        eccentricity = level.eccentricity_scale(factors.N_c, n) / display.eccentricity_scale
        gain = scale ** (1.0 / k.CHROMA_POWER) * eccentricity
        fourth = np.stack([achromatic, power, gain], axis=-1)
        columns = np.swapaxes(matrix, -1, -2)
        numbers = np.concatenate([columns, fourth[..., None]], axis=-1)
        return cls(passage, numbers.reshape(*achromatic.shape, 12))

    def texels(self) -> NDArray[np.float32]:
        """(3, R, C, 4): what ``cam.glsl`` samples, a layer for each column."""
        split = self.numbers.reshape(*self.numbers.shape[:2], 3, 4)
        return np.ascontiguousarray(np.moveaxis(split, 2, 0), dtype=np.float32)

    def within(self, size: tuple[int, int], rows: slice = slice(None)) -> CamPassage:
        """The passage of each pixel of a picture (H, W), or of some of its rows."""
        down, across = (
            between(nodes, pixels)
            for nodes, pixels in zip(self.numbers.shape[:2], size, strict=True)
        )
        there = np.tensordot(down[rows], self.numbers, 1)
        pixels = np.einsum("xc,ycn->yxn", across, there, optimize=True)
        split = pixels.reshape(*pixels.shape[:2], 3, 4)
        return replace(
            self.passage,
            response_from_XYZ=np.swapaxes(split[..., :3], -1, -2),
            scene_achromatic=split[..., 0, 3],
            lightness_power=split[..., 1, 3],
            chroma_gain=split[..., 2, 3],
        )
