"""Matter: isosurfaces, boundaries, labels, coloured glass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import volspec as vs
from tools.gallery.studio import BASIS, STUDIO, Picture, cast, materials, show


def isosurfaces(chest: vs.Volume) -> dict[str, Picture]:
    """Two surfaces of a chest CT: skin and lung at −300 HU, which keep back 12 % of the
    light, and bone at 230 HU. A surface has the opacity that it is given, whatever the step, and
    is as sharp as its voxels: where the ray crosses it is solved for.
    """
    looks = materials(skin="PMC/Caucasian", bone="Vrhel/158 fabric white")
    transfer = vs.Isosurfaces([(-300, 0.12, "skin"), (230, 1.0, {"bone": 0.75})], looks, BASIS)
    pose = {"azimuth_deg": 25, "elevation_deg": 8}
    camera = vs.Camera.orbit(chest, **pose, zoom=1.68, target_mm=(180, 170, 160))
    no_table = replace(STUDIO, crop_voxels=((0, 511), (0, 400), (0, 132)))
    return {"": show(cast(chest, transfer, camera, no_table), exposure=1.7)}


def boundaries(engine: vs.Volume) -> dict[str, Picture]:
    """A curve over values fills the block with fog. Regions of value *and* gradient magnitude
    keep what changes, the walls, and leave out what is even: the inside becomes empty.
    """
    looks = materials(block="Vrhel/64 light blue towel", inserts="copper")
    points = [(70, 0.0, "block"), (100, 0.03, "block"), (170, 0.03, "block"), (190, 0.5, "inserts")]
    curve = vs.TransferFunction(points, looks, BASIS)
    walls = vs.Region((40, 170), (25, math.inf), 0.05, "block", softness=0.5)
    parts = vs.Region((150, 255), (40, math.inf), 0.6, "inserts", softness=0.5)
    plane = vs.TransferFunction2D([walls, parts], looks, BASIS)
    pose = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}
    camera = vs.Camera.orbit(engine, **pose, zoom=1.73, target_mm=(134, 141, 67))
    return {
        "over values": show(cast(engine, curve, camera), exposure=1.3),
        "over values and gradients": show(cast(engine, plane, camera), exposure=1.3),
    }


def labels(frog: vs.Volume) -> dict[str, Picture]:
    """A segmented frog: every label has its own opacity and reflectance, here a translucent
    liver before the rest. Between labels the *looks* are interpolated, never the numbers, so that
    borders are softer than voxels and no third organ appears between two.
    """
    organs = {
        1: ("blood", 0.9, "Vrhel/44 red flower plant had red leaves"),
        2: ("brain", 0.9, "Vrhel/164 fabric pink ii"),
        3: ("duodenum", 0.9, "Vrhel/137 peach skin yellow"),
        4: ("retina", 0.9, "PMC/Blue Sky"),
        5: ("eye", 0.9, "PMC/White"),
        6: ("heart", 0.9, "PMC/Unitary red"),
        7: ("ileum", 0.9, "PMC/Orange"),
        8: ("kidney", 0.9, "Vrhel/67 wheat bread crust"),
        9: ("large intestine", 0.9, "Vrhel/143 pear"),
        10: ("liver", 0.03, "Vrhel/138 peach skin red"),
        11: ("lung", 0.9, "Vrhel/161 fabric pink"),
        12: ("nerve", 0.9, "Vrhel/139 lemon skin"),
        13: ("skeleton", 0.9, "Vrhel/158 fabric white"),
        14: ("spleen", 0.9, "PMC/Purple Cabbage"),
        15: ("stomach", 0.9, "PMC/Bluish Green"),
    }
    looks = {organ: vs.reflectance(name) for organ, _, name in organs.values()}
    parts = {label: (opacity, organ) for label, (organ, opacity, _) in organs.items()}
    transfer = vs.LabelFunction(parts, looks, BASIS)
    camera = vs.Camera.orbit(
        frog, azimuth_deg=0, elevation_deg=60, zoom=1.58, target_mm=(229, 254, 112)
    )
    return {"": show(cast(frog, transfer, camera))}


def coloured_glass(foot: vs.Volume) -> dict[str, Picture]:
    """Bones cast in resin. With `filters` the resin has a transmission spectrum, and every
    channel its own transmittance: what lies deeper, or in denser resin, is not only darker but
    more saturated. Without a filter absorption is grey.
    """
    nm = np.arange(390, 731, 10)
    amber = vs.Spectrum(nm, 0.98 / (1 + np.exp((545 - nm) / 25)), name="amber")
    looks = materials(resin="PMC/White", bone="Vrhel/158 fabric white")
    pose = {"azimuth_deg": 75, "elevation_deg": 35, "up": (-1, 0, 0)}
    camera = vs.Camera.orbit(foot, **pose, zoom=1.48, target_mm=(148, 111, 138))
    matt = replace(STUDIO, specular=0)
    pictures = {}
    ways = {
        "grey absorption": (0.04, None),
        "amber": (0.04, amber),
        "thrice as dense": (0.12, amber),
    }
    for label, (opacity, filtered) in ways.items():
        resin = {"resin": 0.01}  # hardly scatters what it stops
        veil = [(30, 0.0, resin), (40, opacity, resin), (88, opacity, resin)]
        points = [*veil, (108, 0.3, "bone"), (150, 0.7, "bone")]
        filters = {"resin": filtered} if filtered else None
        transfer = vs.TransferFunction(points, looks, BASIS, filters=filters)
        pictures[label] = show(cast(foot, transfer, camera, matt), exposure=1.7)
    return pictures
