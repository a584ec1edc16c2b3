"""Several fields: fluorophores of a microscope's channels, a PET in a CT."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import volspec as vs
from tools.gallery.studio import BASIS, STUDIO, Picture, cast, halved, materials, show


def fluorescence(cells: vs.Volume) -> dict[str, Picture]:
    """Four stains in one cast. A fluorophore absorbs at some wavelengths and emits at others: a
    laser selects the stains that shine, and a filter in the eye's path stops the laser itself.
    Under white light the same stains mix. `D = 0`: the eye does not adapt to a laser.
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


def pet_in_ct(chest: vs.Volume, tracer: vs.Volume) -> dict[str, Picture]:
    """A tracer's uptake, made up, on a lattice of 4 mm in a chest CT of 0.7 mm. Each has its own
    transfer function; where they overlap their extinctions add. The clip plane has
    `fields=("",)`: it opens the CT and leaves the PET whole.
    """
    looks = materials(
        skin="PMC/Caucasian",
        bone="Vrhel/158 fabric white",
        warm="PMC/Orange",
        hot="Vrhel/44 red flower plant had red leaves",
    )
    body = [(-400, 0.0, "skin"), (-200, 0.02, "skin"), (80, 0.006, "skin")]
    ct = vs.TransferFunction([*body, (180, 0.02, "bone"), (320, 0.5, "bone")], looks, BASIS)
    pet = vs.TransferFunction(
        [(0.12, 0.0, "warm"), (0.3, 0.05, "warm"), (0.6, 0.5, "hot")], looks, BASIS
    )
    volume = chest.with_fields([tracer])
    both = vs.FieldFunctions({"": ct, "PET": pet})
    camera = vs.Camera.orbit(
        volume, azimuth_deg=25, elevation_deg=8, zoom=1.68, target_mm=(180, 170, 160)
    )
    no_table = replace(STUDIO, crop_voxels=((0, 511), (0, 400), (0, 132)))
    front = vs.ClipPlane((180, 175, 160), (0, 1, 0), fields=("",))
    return {
        "PET in CT": show(cast(volume, both, camera, no_table), exposure=1.7),
        "the CT cut open": show(
            cast(volume, both, camera, replace(no_table, clip_planes=(front,))), exposure=1.7
        ),
    }
