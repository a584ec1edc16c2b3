"""Design metamers: two reflectances alike in daylight, red and blue under a fluorescent tube.

You should see a report with ΔE below 1 in the column of D65, and 07-palette.png: the palette with
its spectra at the margins.
"""

import volspec as vs
from volspec.palette.figure import save_palette_figure

rows = tuple(vs.PaletteSpectrum(name, free=True, upper=1.0) for name in ("left", "right"))
lights = tuple(vs.PaletteSpectrum(name, vs.light(name)) for name in ("D65", "FL11"))
alike = vs.Cell("free", group="one colour", weight=4)
cells = {
    ("left", "D65"): alike,
    ("right", "D65"): alike,
    ("left", "FL11"): vs.Cell(colour=(0.65, 0.4, 0.4)),
    ("right", "FL11"): vs.Cell(colour=(0.4, 0.45, 0.65)),
}
made = vs.design(vs.Palette(rows, lights, cells, vs.Viewing("CAT02")))
print(vs.DesignReport.of(made))
save_palette_figure(made, "07-palette.png")
