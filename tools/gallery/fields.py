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


def organs_in_ct(chest: vs.Volume, organs: vs.Volume) -> dict[str, Picture]:
    """A segmentation chooses the transfer function of its CT, label by label. Heart, liver and
    muscle have the same Hounsfield units, and no curve over values separates them. Skin and flesh
    have no label here and are left out; bones are as they are. Values remain those of the CT, so
    that the lungs show their vessels.
    """
    looks = materials(
        skin="PMC/Caucasian",
        bone="Vrhel/158 fabric white",
        heart="ColorChecker/moderate red",
        artery="ColorChecker/red",
        vein="ColorChecker/blue",
        lung="ColorChecker/blue flower",
        liver="Vrhel/57 brown leather bass saddle shoe",
        spleen="ColorChecker/purple",
        kidney="PMC/Orange",
        stomach="PMC/Pork",
        bowel="Vrhel/137 peach skin yellow",
        cartilage="Vrhel/150 sand",
    )

    def curve(*points: tuple[float, float, str]) -> vs.TransferFunction:
        return vs.TransferFunction(points, looks, BASIS)

    soft = {
        "heart": ("heart", "atrial"),
        "artery": ("aorta", "brachiocephalic_trunk", "subclavian", "common_carotid"),
        "vein": ("superior_vena", "inferior_vena", "brachiocephalic_vein", "portal", "pulmonary"),
        "liver": ("liver",),
        "spleen": ("spleen",),
        "kidney": ("kidney_left", "kidney_right"),
        "stomach": ("stomach", "esophagus", "pancreas"),
        "bowel": ("colon", "small_bowel", "duodenum"),
    }
    curves = {look: curve((-80, 0.0, look), (40, 0.5, look)) for look in soft}
    curves["lung"] = curve((-720, 0.0, "lung"), (-500, 0.03, "lung"), (-100, 0.3, "lung"))
    curves["cartilage"] = curve((-20, 0.0, "cartilage"), (120, 0.3, "cartilage"))
    curves["bone"] = curve((100, 0.0, "bone"), (250, 0.6, "bone"))
    parts = {"lung": ("lung",), "cartilage": ("costal",)} | soft

    def labels(*names: str) -> list[int]:
        return [n for n, label in organs.labels.items() if label.name.startswith(names)]

    by_label = {n: curves[look] for look, names in parts.items() for n in labels(*names)}
    skeleton = labels("rib", "vertebrae", "sternum", "scapula", "clavicula", "humerus")
    hidden = labels("rib_left", "costal", "lung_upper_lobe_left", "lung_lower_lobe_left")
    skin = [(-400, 0.0, "skin"), (-200, 0.02, "skin"), (80, 0.006, "skin")]
    bones = [(180, 0.0, "bone"), (320, 0.6, "bone")]
    nothing = curve((0, 0.0, "skin"))
    opened = by_label | dict.fromkeys(skeleton, curves["bone"]) | dict.fromkeys(hidden)
    transfers = {
        "the CT alone": curve(*skin, *bones),
        "organs by label": vs.FieldFunctions(
            {"": curve(*bones)}, masks={"": vs.Mask("organs", by_label)}
        ),
        "labels alone, some hidden": vs.FieldFunctions(
            {"": nothing}, masks={"": vs.Mask("organs", opened)}
        ),
    }
    volume = chest.with_fields([organs])
    camera = vs.Camera.orbit(
        volume, azimuth_deg=20, elevation_deg=6, zoom=1.68, target_mm=(180, 170, 160)
    )
    spec = replace(STUDIO, crop_voxels=((0, 511), (0, 400), (0, 132)))
    return {
        label: show(cast(volume, transfer, camera, spec), exposure=1.3)
        for label, transfer in transfers.items()
    }
