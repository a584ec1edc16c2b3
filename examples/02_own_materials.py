"""Choose reflectances by name or colour, and swap them without another cast.

You should see 02-gold.png and 02-jade.png: a bluish block, its inserts golden, then green.
The channels of a `MaterialBasis` are its materials, so that their spectra can be swapped.
"""

import volspec as vs

volume = vs.load_volume("data/engine.nrrd")
materials = {"block": vs.reflectance("ColorChecker/blue sky"), "inserts": vs.reflectance("gold")}
points = [(90, 0.0, "block"), (130, 0.03, "block"), (180, 0.1, "inserts"), (220, 0.7, "inserts")]
transfer = vs.TransferFunction(points, materials, vs.MaterialBasis(materials))
camera = vs.Camera.orbit(volume, azimuth_deg=150, elevation_deg=-35, zoom=1.5)

image = vs.raycast(volume, transfer, camera, size=(320, 320))
with vs.Relighter(image) as relighter:
    vs.write_frame("02-gold.png", relighter.frame(vs.light("D65")))
    relighter.set_reflectances({"inserts": vs.reflectance_from_colour("#3f8f5f")})
    vs.write_frame("02-jade.png", relighter.frame(vs.light("D65")))
