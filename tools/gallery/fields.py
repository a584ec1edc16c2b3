"""Several fields: fluorophores of a microscope's channels."""

from __future__ import annotations

import numpy as np

import volspec as vs
from tools.gallery.studio import Picture, cast, halved


def fluorescence(cells: vs.Volume) -> dict[str, Picture]:
    """Four stains in one cast. A fluorophore absorbs at some wavelengths and emits at others, so
    that a laser picks what is seen, and a filter in the eye's path keeps the laser out. Under a
    lamp of white light the same stains mix. `D = 0`: the eye does not adapt to a laser.
    """
    stains = {
        "nuclei": ("mTagBFP2", 0.04),
        "actin": ("EGFP", 0.10),
        "mito": ("Alexa Fluor 568", 0.08),
        "vesicles": ("Alexa Fluor 647", 0.12),
    }
    dyes = {dye: vs.reflectance(f"fluorophore:{dye}") for dye, _ in stains.values()}
    basis = vs.MaterialBasis(dyes)
    functions = {
        "" if name == "nuclei" else name: vs.TransferFunction(
            [(20, 0.0, dye), (255, opacity, dye)],
            dyes,
            basis,
            reference_step_mm=cells.spacing_mm[0],
        )
        for name, (dye, opacity) in stains.items()
    }
    camera = vs.Camera.orbit(cells, azimuth_deg=-20, elevation_deg=62, zoom=1.12)
    spec = vs.RaycastSpec(ambient=1.0, diffuse=0.0, specular=0.0, jitter=1)
    image = cast(cells, vs.FieldFunctions(functions), camera, spec)
    pictures = {}
    for lamp, passed, exposure in (
        ("laser:405", "longpass:420", 2.5),
        ("laser:488", "longpass:500", 0.8),
        ("laser:561", "longpass:575", 2.5),
        ("laser:640", "longpass:655", 30.0),
        ("D65", None, 4.0),
    ):
        viewing = vs.Viewing(D=0.0, exposure=exposure)
        seen = vs.RelightSpec(viewing, backdrop=0.0, filter=passed)
        label = f"{lamp}, {passed}" if passed else lamp
        pictures[label] = halved(vs.relight(image, vs.light(lamp), seen, np.float32))
    return pictures
