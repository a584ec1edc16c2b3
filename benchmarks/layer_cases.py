"""Volumes, functions, lights and errors that the benchmarks of layers share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import PAGE
from benchmarks.scenes import RECIPES, Points, chest, stored
from volspec._gpu.sources import asset
from volspec.appearance.display.spaces import decode_sRGB, encode_sRGB, linear_sRGB_from_XYZ
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.basis import Basis, MaterialBasis
from volspec.image.fields import ONE_GROUP
from volspec.raycast import RaycastSpec
from volspec.raycast.lights import HEADLIT, Ambient, Directional, Headlight, LightGroup
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.spectra import light, reflectance
from volspec.transfer import LabelFunction, TransferFunction
from volspec.volume import Volume, load_volume

Array = NDArray[np.float64]
SPEC = RaycastSpec(ambient=0.3, diffuse=0.7, specular=0.2, shininess=24, alpha_stop=1.0)
MATERIALS = {
    "skin": "ColorChecker/light skin",
    "brass": "brass",
    "sky": "ColorChecker/blue sky",
    "leaf": "ColorChecker/foliage",
}
LAMP = Directional((1.0, 0.75, 0.6), frame="camera", intensity=0.7, shadows=True)
HEAD = Ambient(), Headlight(0.3)
RIGS = {
    "": HEADLIT,
    "own group": (LightGroup("head", HEAD), LightGroup("lamp", LAMP)),
    "one group": (LightGroup("light", (*HEAD, LAMP)),),
    "occlusion": (LightGroup("light", (Ambient(occlusion=True), Headlight())),),
}
LAYERS_PAGE = PAGE.parent / "layers.md"


def _bundled(name: str) -> Callable[[], Volume]:
    """Return a reader of a volume that ships."""
    return lambda: load_volume(asset(f"data/{name}.nrrd"))


Case = tuple[Callable[[], Volume], Points, dict[str, Any]]
# A volume, the points of its function, and keywords of its orbit. Materials follow from the order
# of the recipe's.
_ENGINE: Points = (
    *((88, 0.0, "skin"), (108, 0.045, "skin"), (128, 0.045, "skin")),
    *((140, 0.03, "brass"), (165, 0.03, "brass"), (180, 0.12, "sky")),
    *((200, 0.5, "sky"), (255, 0.9, "sky")),
)
_VIEW = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}
_FROG: Points = (
    *((20, 0.0, "skin"), (36, 0.02, "skin"), (70, 0.03, "skin")),
    *((85, 0.06, "brass"), (110, 0.08, "brass")),
    *((130, 0.25, "sky"), (190, 0.6, "sky"), (255, 0.8, "sky")),
)
CASES: dict[str, Case] = {
    "engine": (_bundled("engine"), _ENGINE, _VIEW),
    "foot": (stored("foot"), RECIPES["foot"].points, RECIPES["foot"].camera),
    "mrbrain": (_bundled("mrbrain"), RECIPES["mrbrain"].points, RECIPES["mrbrain"].camera),
    "aneurism": (stored("aneurism"), RECIPES["aneurism"].points, RECIPES["aneurism"].camera),
    "frog": (stored("frog"), _FROG, {"azimuth_deg": 30, "elevation_deg": 40}),
}


def _labels() -> Volume:
    """Return the engine's materials by value, as labels."""
    engine = CASES["engine"][0]()
    labels = np.digitize(engine.values, (100, 134, 172)).astype(np.uint8)
    return Volume(labels, spacing_mm=engine.spacing_mm, name="labels")


_TWO: Points = tuple((v, a, "sky" if name == "brass" else name) for v, a, name in _ENGINE)
_FOUR: Points = (*_ENGINE[:-1], (235, 0.5, "leaf"), (255, 0.9, "leaf"))
OTHERS: dict[str, Case] = {
    "engine, K=2": (_bundled("engine"), _TWO, _VIEW),
    "engine, K=4": (_bundled("engine"), _FOUR, _VIEW),
    # A label's opacity and material.
    "labels": (_labels, ((1, 0.045, "skin"), (2, 0.03, "brass"), (3, 0.4, "sky")), _VIEW),
    "chest CT": (chest, RECIPES["chest"].points, RECIPES["chest"].camera),
}


def transfer_of(points: Points) -> TransferFunction | LabelFunction:
    """Return a function of up to four materials, in the order in which the points name theirs.

    It is of labels, if the points are numbered from 1.
    """
    used = dict.fromkeys(name for *_, name in points)
    names = dict(zip(used, MATERIALS, strict=False))
    materials = {names[name]: reflectance(MATERIALS[names[name]]) for name in used}
    basis = MaterialBasis(materials)
    if points[0][0] == 1:
        return LabelFunction({int(n): (a, names[name]) for n, a, name in points}, materials, basis)
    renamed = [(value, opacity, names[name]) for value, opacity, name in points]
    return TransferFunction(points=renamed, materials=materials, basis=basis)


def display(
    basis: Basis, shares: Mapping[str, float] = ONE_GROUP
) -> Callable[[Array, Array], Array]:
    """Return the function from channels (…, R, [G,] K + 1) and transmittance (…, R) to sRGB codes.

    Under D65, in front of black.
    """
    black = RelightSpec(mode="exact", backdrop=0.0)
    lit = Illumination.of(basis, LightRig.of(light("D65")), black, shares)

    def codes(channels: Array, through: Array) -> Array:
        XYZ = channels.reshape(*through.shape, -1) @ lit.XYZ_from_channels.T
        XYZ += through[..., None] * lit.backdrop_XYZ
        return encode_sRGB(np.clip(linear_sRGB_from_XYZ(XYZ), 0, 1))

    return codes


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors over combinations and pixels.

    RMS of sRGB codes; CIEDE2000: the mean, the mean of the worst combination, 99 % and the most.
    """

    rms: float
    mean: float
    worst: float
    most_of: float
    most: float

    @classmethod
    def of(cls, shown: Array, true: Array) -> Errors:
        """Compare (combinations, pixels, 3) sRGB codes."""
        white = np.array([95.047, 100.0, 108.883])
        XYZ_from_linear = np.linalg.inv(linear_sRGB_from_XYZ(np.eye(3)).T)
        labs = [cielab(decode_sRGB(each) @ XYZ_from_linear.T, white) for each in (shown, true)]
        off = delta_E_2000(*labs)
        return cls(
            float(np.sqrt(np.mean((shown - true) ** 2))),
            float(off.mean()),
            float(off.mean(axis=1).max()),
            float(np.percentile(off, 99)),
            float(off.max()),
        )
