"""Materials, and each kind of transfer function made of them."""

from volspec.basis import SpectralBasis
from volspec.spectra import reflectance
from volspec.transfer import Isosurfaces, LabelFunction, TransferFunction, TransferFunction2D

BASIS = SpectralBasis.load("general-7")
MATERIALS = {name: reflectance(name) for name in ("copper", "steel", "gold")}
COPPER, STEEL, GOLD = (BASIS.analyse(spectrum) for spectrum in MATERIALS.values())


def curve(*points: object, **settings: object) -> TransferFunction:
    return TransferFunction(points, MATERIALS, BASIS, **settings)


def labels(given: object, **settings: object) -> LabelFunction:
    return LabelFunction(given, MATERIALS, BASIS, **settings)


def surfaces(*given: object) -> Isosurfaces:
    return Isosurfaces(given, MATERIALS, BASIS)


def regions(*given: object, **settings: object) -> TransferFunction2D:
    return TransferFunction2D(given, MATERIALS, BASIS, **settings)
