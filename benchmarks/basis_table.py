"""How good are bases? CIEDE2000 against 31 bands: ``python -m benchmarks.basis_table``.

Fits on the 128 training reflectances, measured on the 84 held-out ones, the light as white;
METHOD section 2 has the table to beat. Takes half a minute.
"""

from __future__ import annotations

from collections.abc import Iterator

from volspec.basis import ErrorSummary, SpectralBasis
from volspec.basis.report import rgb_product_delta_e
from volspec.spectra import light_set, reflectance_set

SIZES = (5, 7, 9)


def bases() -> Iterator[SpectralBasis]:
    """Each method trained on the 26 smooth lights, and the basis that ships."""
    lights, reflectances = light_set("smooth"), reflectance_set("training")
    for size in SIZES:
        for name, options in (
            ("virtual-sensors", {}),
            ("virtual-sensors, positive", {"positive": True}),
            ("pca-sharpened", {"method": "pca-sharpened"}),
        ):
            yield SpectralBasis.fit(
                lights, reflectances, size=size, name=f"{name}, m = {size}", **options
            )
    yield SpectralBasis.load("general-7")


def main() -> None:
    """Print the table."""
    test = reflectance_set("test")
    sets = {kind: light_set(kind) for kind in ("smooth", "spiky")}
    print(f"{'mean / median / 95 % / max':48s}" + "".join(f"{f'{k} lights':32s}" for k in sets))
    products = [str(ErrorSummary.of(rgb_product_delta_e(sets[kind], test))) for kind in sets]
    _print("RGB product (sharp sensors)", "", products)
    for basis in bases():
        reports = [basis.report(lights, test) for lights in sets.values()]
        _print(basis.name, "componentwise", [str(r.componentwise) for r in reports])
        _print(basis.name, "exact", [str(r.exact) for r in reports])


def _print(name: str, mode: str, cells: list[str]) -> None:
    print(f"{name:34s}{mode:14s}" + "".join(f"{cell:32s}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
