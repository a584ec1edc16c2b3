"""A chart under two light groups, and files of it as other programs open them."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from tests.support.commands import CHART, GENERAL, METALS
from volspec.appearance import Viewing
from volspec.appearance.display.spaces import SPACES
from volspec.basis import Basis, MaterialBasis
from volspec.export.compositing import Recipe, save_for_compositors
from volspec.image import CoefficientImage
from volspec.image.layers import OpacityLayers
from volspec.relight import LightRig, RelightSpec, relight
from volspec.spectra import light

EVENING = LightRig((light("A"), light("daylight:7500*0.4")), groups=("key", "the sky"))
LIGHTS = {"day": light("D65"), 'fluorescent {"$x"]': light("FL2"), "evening": EVENING}
SHARES = {"key": 0.7, "the sky": 0.3}
NOTES = {"viewing": '{"backdrop": 0.25, "exposure": 1.25}'}
HALF = 2.0**-11  # a half float's rounding, of its value; below 2^-14 half of 2^-24
SPEC = RelightSpec(Viewing(model="Bradford", exposure=1.25), backdrop=0.25)


def made(basis: Basis = GENERAL, kind: type = np.float32) -> CoefficientImage:
    """Held-out reflectances, or shares of two metals, from below a key to below the sky."""
    if isinstance(basis, MaterialBasis):
        own = np.random.default_rng(7).dirichlet(np.ones(3), (7, 12))
    else:
        own = basis.analyse(CHART)
    alpha = np.linspace(0, 1, 84, dtype=np.float32).reshape(7, 12)
    ramp = np.linspace(0, 1, 12)[:, None]
    layers = np.concatenate([0.6 * (1 - ramp) * own, 0.25 * ramp * own], -1) * alpha[..., None]
    return CoefficientImage(
        *(layers.astype(kind), alpha, alpha, basis, NOTES), groups=SHARES, first_mm=alpha
    )


def layered(count: int = 3, shadows: bool = False, solid: bool = False) -> CoefficientImage:
    """Return two metals in layers, of which pixels use some, and a picture a little off.

    With shadows the key has them, and the sky has both them and occlusion; if solid, the last layer
    is of surfaces.
    """
    rng, size = np.random.default_rng(3), (7, 12)
    tau = rng.exponential(0.4, (*size, count, 2)).astype(np.float16)
    used = np.arange(count) < rng.integers(0, count + 1, (*size, 1))
    tau[~used] = 0
    tau[..., 1][rng.random((*size, count)) < 0.3] = 0
    used = tau.any(axis=-1)
    shade = rng.uniform(0.2, 1.0, (*size, count, 2, 2)) * (tau > 0)[:, :, :, None]
    gloss = rng.uniform(0, 0.2, (*size, count, 2)) * used[..., None]
    depth = np.where(used, np.arange(count) + 10.0, np.inf)
    arrays = (each.astype(np.float16) for each in (shade, gloss, depth))
    layers = OpacityLayers(tau, *arrays)
    if shadows:
        casts = np.zeros((2, *size, count, 2, 5), np.float32)
        casts[..., :2] = rng.uniform(0.1, 0.5, (2, *size, count, 2, 2))
        casts[..., 2] = rng.choice([1e-3, 0.3, 2.0], (2, *size, count, 2))
        casts[..., 3:] = rng.exponential(0.5, (2, *size, count, 2, 2))
        casts[1, ..., 0, :] = 0
        casts[:, ~used] = 0
        layers = dataclasses.replace(layers, shadow=casts[0], occlusion=casts[1])
    layers = dataclasses.replace(layers, solid=solid).as_stored()
    found = layers.recompose([1.0, 1.0])
    off = rng.uniform(0.97, 1.0, found.channels.shape).astype(np.float32)
    coefficients = (found.channels * off).reshape(*size, -1)
    alpha = found.alpha * off[..., 0, 0]
    return CoefficientImage(
        *(coefficients, alpha, np.where(alpha > 0, 10, np.inf).astype(np.float32), METALS),
        groups=SHARES,
        opacity_layers=layers,
    )


def stored(path: Path, image: CoefficientImage, spec: RelightSpec = SPEC) -> Recipe:
    recipe = Recipe.of(image.basis, image.groups, LIGHTS, spec)
    save_for_compositors(image, path, recipe)
    return recipe


def opened(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and channels by OpenEXR's own library alone."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {k: np.array(c.pixels) for k, c in file.channels().items()}


def shown(image: CoefficientImage, name: str, spec: RelightSpec = SPEC) -> NDArray[Any]:
    """Linear light of volspec's own frame: an eye that adapts by Bradford, black behind."""
    spec = dataclasses.replace(spec, backdrop=0.0)
    codes = relight(image, LIGHTS[name], spec, dtype=np.float32, backend="numpy")
    return SPACES["sRGB"].decode(codes)


def close(found: NDArray[Any], frame: NDArray[Any]) -> bool:
    """Frames are cut to the display's gamut; else nine digits and float32 bound the error."""
    return np.allclose(np.clip(found, 0, 1), frame, rtol=1e-5, atol=2e-6)
