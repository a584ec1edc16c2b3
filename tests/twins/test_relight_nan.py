"""No NaN and no infinity in any frame: lights of next to nothing, and designed spectra.

The cubes of Rec. 2020 and ACES, black, L_A = 0 and Y_b = 0 stand in `test_relight_models`.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.twins.test_relight import needs_gl  # noqa: F401
from volspec.appearance import Display, Viewing
from volspec.appearance.spec import MODELS
from volspec.basis import SpectralBasis
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.relight.cpu import CpuEngine
from volspec.relight.gpu import GLEngine
from volspec.spectra import Spectrum, light

BASIS = SpectralBasis.load("general-7")
BANDS = BASIS.grid.size


def blocks(count: int, seed: int) -> np.ndarray:
    """(count, BANDS) 0 and 1 in runs of one to eight bands, as a palette designer's optima are."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(count):
        runs = rng.integers(1, 9, BANDS)
        rows.append(np.repeat(np.arange(BANDS) % 2, runs)[:BANDS] ^ rng.integers(0, 2))
    return np.array(rows, dtype=np.float64)


def designed() -> np.ndarray:
    """(N, BANDS) reflectances: blocks, single bands, bands left out, stripes, black and white."""
    stripes = (np.arange(BANDS) // np.arange(1, 9)[:, None]) % 2
    one = np.eye(BANDS)
    rest = [np.zeros((1, BANDS)), np.ones((1, BANDS)), -0.2 * np.ones((1, BANDS))]
    return np.concatenate([blocks(150, 1), one, 1.0 - one, stripes, 1 - stripes, *rest])


def lamp(values: np.ndarray) -> Spectrum:
    return Spectrum(BASIS.grid.wavelengths_nm, values)


def lights() -> dict[str, Spectrum | LightRig]:
    """Next to no power (none is refused), one band, some, and LEDs with nothing between."""
    nm = BASIS.grid.wavelengths_nm
    leds = {
        f"LEDs {centres}": lamp(
            sum(np.where(np.abs(nm - centre) < 30, np.exp(-(((nm - centre) / 12) ** 2)), 0.0)
                for centre in centres)
        )
        for centres in ((460, 530, 630), (440, 590), (500, 700))
    }  # fmt: skip
    bands = {f"{n:g} nm": lamp(1.0 * (nm == n)) for n in (nm[0], 450.0, 510.0, 590.0, nm[-1])}
    return {
        "1e-100 of D65": lamp(1e-100 * light("D65", BASIS.grid).values),
        "1e-30 lux": LightRig((light("A", BASIS.grid),), illuminance_lux=(1e-30,)),
        **bands,
        **leds,
        **{f"blocks {i}": lamp(values) for i, values in enumerate(blocks(3, 2))},
    }


LIGHTS = lights()
VIEWINGS = (
    {},
    {"discount": True, "display": Display(L_A=0.05, surround="dark")},
    {"L_A": 0.0, "Y_b": 0.0, "display": Display(L_A=0.0, Y_b=0.0)},
)


@pytest.mark.parametrize("model", MODELS)
def test_designed_spectra_under_designed_lights_give_no_nan(model: str) -> None:
    spectra = designed()
    assert len(spectra) % 3 == 0
    coefficients = BASIS.analyse(spectra).reshape(3, -1, BASIS.size).astype(np.float32)
    alpha = np.ones(coefficients.shape[:2], np.float32)
    alpha[0, :4] = 0.0
    # Two models have no closed form: always looked up, in a table that takes the host a second.
    tabled = model in ("Hunt", "Nayatani95")
    kinds = (True,) if tabled else (False, True)
    engines = [GLEngine(coefficients, alpha, lut3d=table) for table in kinds]
    engines.append(CpuEngine(coefficients, alpha))
    worst = 0.0
    for turn, (name, lit) in enumerate(LIGHTS.items()):
        if tabled and turn % 4:  # the next light's table is as hard
            continue
        looks = VIEWINGS[turn // 2 % 3 :][:1] if tabled else VIEWINGS
        level = "absolute" if isinstance(lit, LightRig) else "relative"
        for others in looks:
            viewing = Viewing(model=model, **others)
            seen = Illumination.of(BASIS, lit, RelightSpec(viewing, level=level))
            for engine in engines:
                frame = engine.render(seen, viewing, np.float32)
                what = (model, name, others, engine.name)
                assert np.isfinite(frame).all(), what
                assert frame.min() >= 0.0 and frame.max() <= 1.0, what
                worst = max(worst, float(frame.max()))
    # Not by being black all over.
    assert worst > 0.9
    for engine in engines:
        engine.close()
