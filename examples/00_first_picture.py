"""Cast the bundled engine and write one frame.

You should see 00-engine.png: a pale engine block with copper inserts, in daylight.
"""

import volspec as vs

volume = vs.load_volume("data/engine.nrrd")
materials = {"block": vs.reflectance("aluminium"), "inserts": vs.reflectance("copper")}
points = [(90, 0.0, "block"), (130, 0.04, "block"), (180, 0.1, "inserts"), (220, 0.7, "inserts")]
transfer = vs.TransferFunction(points, materials, vs.SpectralBasis.load("general-7"))
camera = vs.Camera.orbit(volume, azimuth_deg=150, elevation_deg=-35, zoom=1.5)

image = vs.raycast(volume, transfer, camera, size=(320, 320))
vs.write_frame("00-engine.png", vs.relight(image, vs.light("D65")))
