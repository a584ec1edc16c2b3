"""Export a turntable, every light of the scene for every camera.

You should see 08-frames/ with four views of the engine under each light, and a second run that
finds them there and returns at once.
"""

import volspec as vs

scene = vs.Scene.load("data/scenes/engine.toml")
for _ in range(2):
    exported = vs.export(scene, "08-frames", size=(160, 160), turntable={"frames": 4})
    print(exported)
