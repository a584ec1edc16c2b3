"""Adapt the eye: one tungsten-lit image under four viewings.

You should see 05-*.png: orange without adaptation (none), nearly neutral with CAT02 and CIECAM02,
and a little warmer in the dim light of 5 lux, to which the eye adapts less.
"""

import volspec as vs

scene = vs.Scene.load("data/scenes/engine.toml")
image = scene.render(size=(320, 320))
viewings = {
    "none": vs.Viewing("none"),
    "CAT02": vs.Viewing("CAT02"),
    "CIECAM02": vs.Viewing("CIECAM02"),
    "dim": vs.Viewing("CIECAM02", illuminance_lux=5),
}
with vs.Relighter(image) as relighter:
    for name, viewing in viewings.items():
        frame = relighter.frame(vs.light("A"), vs.RelightSpec(viewing, backdrop=0.05))
        vs.write_frame(f"05-{name}.png", frame)
