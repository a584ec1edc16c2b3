"""Cast a scene once and relight it with every light of its file.

You should see 01-*.png: inserts that match the block in daylight (D65) and turn pink under
tungsten (A) and violet under sodium (HP1). A relight takes milliseconds, the cast about a second.
"""

import time

import volspec as vs

scene = vs.Scene.load("data/scenes/engine.toml")
image = scene.render(size=(320, 320))
with vs.Relighter(image) as relighter:
    for light in scene.lights:
        start = time.perf_counter()
        frame = relighter.frame(light.rig, scene.relight)
        print(f"{light.name}: {1000 * (time.perf_counter() - start):.1f} ms")
        vs.write_frame(f"01-{light.name}.png", frame)
