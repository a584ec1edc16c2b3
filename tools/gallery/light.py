"""Light: shadows, occlusion, groups that are steered apart, metamers."""

from __future__ import annotations

from dataclasses import replace

import volspec as vs
from tools.gallery.studio import BASIS, FILL, KEY, STUDIO, Picture, cast, engine_scene, show


def shadows(foot: vs.Volume) -> dict[str, Picture]:
    """Skin and flesh as a veil, bone within. The key light's shadow and the hidden parts of the
    sky show which bone lies above which; without them all are equally bright. Each lamp's light
    is marched through the volume once, at every change of the transfer function.
    """
    names = {
        "skin": "Vrhel/81 skin caucasian light",
        "flesh": "PMC/Pork",
        "bone": "Vrhel/158 fabric white",
    }
    veil = [(30, 0.0, "skin"), (40, 0.03, "skin"), (52, 0.008, "skin"), (88, 0.008, "flesh")]
    points = [*veil, (105, 0.15, "bone"), (150, 0.6, "bone")]
    looks = {key: vs.reflectance(name) for key, name in names.items()}
    transfer = vs.TransferFunction(points, looks, BASIS)
    pose = {"azimuth_deg": 75, "elevation_deg": 35, "up": (-1, 0, 0)}
    camera = vs.Camera.orbit(foot, **pose, zoom=1.48, target_mm=(148, 111, 138))
    key = vs.Directional((-1, 1.2, 0.7), frame="camera", intensity=1.3, shadows=True)
    pictures = {}
    for label, on in (("neither", False), ("shadows and occlusion", True)):
        lamps = (replace(key, shadows=on), *FILL.sources, vs.Ambient(occlusion=on))
        spec = replace(STUDIO, groups=(vs.LightGroup("lamps", lamps),))
        pictures[label] = show(cast(foot, transfer, camera, spec))
    return pictures


def light_groups(mrbrain: vs.Volume) -> dict[str, Picture]:
    """A plaster head between two lamps: one cast, three pictures. Each light group left its own
    layer of channels, so that key and fill get their spectra, and their strengths, afterwards.
    The eye adapts to the mixture of the two.
    """
    points = [(38, 0.0, "plaster"), (56, 0.5, "plaster"), (90, 0.8, "plaster")]
    looks = {"plaster": vs.reflectance("Vrhel/144 sugar white")}
    transfer = vs.TransferFunction(points, looks, BASIS)
    pose = {"azimuth_deg": 40, "elevation_deg": 30, "up": (0, 0, -1)}
    camera = vs.Camera.orbit(mrbrain, **pose, zoom=2.2, target_mm=(129, 131, 74))
    side = vs.Directional((1.5, -0.3, 0.6), frame="camera", intensity=0.8, shadows=True)
    fill = vs.LightGroup("fill", (side, vs.Ambient(0.5, occlusion=True)))
    image = cast(mrbrain, transfer, camera, replace(STUDIO, groups=(KEY, fill)))
    pictures = {"daylight": show(image, "D65")}
    mixed = {
        "tungsten and blue sky": ("A", "daylight:15000"),
        "sodium and daylight": ("HP1", "D65"),
    }
    for label, (key, other) in mixed.items():
        lights = (vs.light(key), vs.light(other))
        rig = vs.LightRig(lights, illuminance_lux=(600, 600), groups=("key", "fill"))
        pictures[label] = show(image, rig)
    return pictures


def ambient_occlusion(mrbrain: vs.Volume) -> dict[str, Picture]:
    """A sky and a weak headlight. What lies in a furrow sees little of the sky and gets dark;
    `radius_mm` sets how far structures block each other's light.
    """
    points = [(38, 0.0, "brain"), (56, 0.5, "brain"), (90, 0.8, "brain")]
    looks = {"brain": vs.reflectance("Vrhel/164 fabric pink ii")}
    transfer = vs.TransferFunction(points, looks, BASIS)
    pose = {"azimuth_deg": -60, "elevation_deg": 50, "up": (0, 0, -1)}
    camera = vs.Camera.orbit(mrbrain, **pose, zoom=2.2, target_mm=(142, 141, 86))
    pictures = {}
    for label, on in (("open sky", False), ("occluded sky", True)):
        sky = (vs.Ambient(occlusion=on, radius_mm=20), vs.Headlight(0.3))
        group = vs.LightGroup("light", sky)
        spec = replace(STUDIO, groups=(group,), ambient=0.7, light_cells=192)
        pictures[label] = show(cast(mrbrain, transfer, camera, spec))
    return pictures


def metamers(engine: vs.Volume) -> dict[str, Picture]:
    """The demo's engine with shadows: block and inserts match in daylight and part under
    tungsten. On the right only the key is tungsten, the rest daylight. All three are one cast.
    """
    scene = engine_scene()  # data/scenes/engine.toml
    pose = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}
    camera = vs.Camera.orbit(engine, **pose, zoom=1.73, target_mm=(134, 141, 67))
    image = cast(engine, scene.transfer, camera)
    lights = [vs.light(name) for name in ("A", "D65", "D65")]
    rig = vs.LightRig(lights, groups=("key", "fill", "sky"))
    return {
        "daylight": show(image, "D65", exposure=1.4),
        "tungsten": show(image, "A", exposure=1.4),
        "tungsten key, daylight around": show(image, rig, exposure=1.4),
    }
