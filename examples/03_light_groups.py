"""Light groups: sources with spectra of their own, blended after the cast.

You should see black shadows in 03-key.png, soft light in 03-sky.png, and shadows filled with blue
in 03-both.png, where the eye adapts to both lights.
"""

import volspec as vs

scene = vs.Scene.load("data/scenes/engine.toml")
spec = vs.RaycastSpec(
    diffuse=0.9,
    groups=(
        vs.LightGroup("key", (vs.Directional((1, 0.75, 0.6), frame="camera", shadows=True),)),
        vs.LightGroup("sky", (vs.Ambient(occlusion=True, radius_mm=40),)),
    ),
)
image = scene.render(size=(320, 320), spec=spec)
lights = vs.light("planck:3000"), vs.light("daylight:9000")
with vs.Relighter(image) as relighter:
    for name, weights in {"key": (1, 0), "sky": (0, 1), "both": (1, 1)}.items():
        rig = vs.LightRig(lights, weights=weights, groups=("key", "sky"))
        vs.write_frame(f"03-{name}.png", relighter.frame(rig, scene.relight))
