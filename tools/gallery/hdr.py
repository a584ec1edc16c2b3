"""Make docs/images/hdr.jpg and hdr.avif: ``python -m tools.gallery.hdr``; needs volspec[video].

data/scenes/engine-surfaces.toml, polished -> [hdr] -> a frame in PQ; it and an SDR frame, darker
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import volspec as vs
from tools.gallery.rooms import IMAGES, save
from tools.gallery.studio import ROOT
from volspec.appearance.display.hdr import Hdr
from volspec.appearance.display.monitors import preset
from volspec.appearance.display.spaces import SPACES, encode_sRGB, to_uint16
from volspec.relight.hdr import hdr_frame

SIZE, STOPS, LUX = (840, 720), 2.0, 500.0
HDR = Hdr("PQ", peak_cd_m2=1000.0)


def main() -> None:
    """Write the frame and the pair, and print how bright it is."""
    file = vs.Scene.load(ROOT / "data" / "scenes" / "engine-surfaces.toml").file
    polished = replace(file.raycast, specular=5.0, shininess=60)
    scene = vs.Scene(replace(file, raycast=polished), ROOT / "data/scenes/engine-surfaces.toml")
    image = scene.render(size=SIZE)
    lamp = vs.LightRig((vs.light("planck:3200"),), illuminance_lux=(LUX,))
    viewing = vs.Viewing(model="CAM16", display=preset("HDR studio").display())
    codes = hdr_frame(image, lamp, vs.RelightSpec(viewing, backdrop=0.02), HDR)
    vs.write_frame(IMAGES / "hdr.avif", to_uint16(codes), space=HDR)
    luminances = HDR.luminances(codes)
    Y = luminances @ (SPACES["Rec. 2020"].XYZ_from_RGB[1] / 100.0)
    print(
        f"{IMAGES / 'hdr.avif'}: white {HDR.white_cd_m2:g} cd/m², brightest {Y.max():.0f}, "
        f"{(HDR.white_cd_m2 < Y).mean():.1%} above white"
    )
    relative = luminances / HDR.white_cd_m2
    save(np.hstack([darker(np.minimum(relative, 1.0)), darker(relative)]), "hdr.jpg")


def darker(relative: np.ndarray) -> np.ndarray:
    """Return sRGB codes of light relative to white, darker by `STOPS`."""
    matrix = SPACES["sRGB"].RGB_from_XYZ @ SPACES["Rec. 2020"].XYZ_from_RGB
    return np.rint(255.0 * encode_sRGB(2.0**-STOPS * relative @ matrix.T)).astype(np.uint8)


if __name__ == "__main__":
    main()
