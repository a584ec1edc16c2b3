"""Find a reflectance for a colour, and its colour under other lights.

You should see 06-swatches.png: one row for each colour, one column for each light. The first
column is the colour itself; under sodium (the last) all are orange.
"""

import numpy as np

import volspec as vs
from volspec.appearance.display.monitors import colour_space
from volspec.spectra import XYZ_from_spectra

space = colour_space("sRGB")
rows = []
for colour in ("#c08040", "#4080c0", "#60a050"):
    reflectance = vs.reflectance_from_colour(colour)
    XYZ = [XYZ_from_spectra(vs.light(name), reflectance) for name in ("D65", "A", "FL2", "HP1")]
    codes = np.clip(space.encode(np.array(XYZ) @ space.RGB_from_XYZ.T), 0.0, 1.0)
    print(colour, *("#" + bytes(np.rint(255 * row).astype(np.uint8)).hex() for row in codes))
    rows.append(np.rint(255 * codes).astype(np.uint8))
vs.write_frame("06-swatches.png", np.array(rows).repeat(80, axis=0).repeat(80, axis=1))
