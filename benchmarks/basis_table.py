"""How good are bases? CIEDE2000 against 31 bands: ``python -m benchmarks.basis_table``.

Trained on the 128 training reflectances, measured on the 84 held-out ones, the light as white;
METHOD section 2 has the table to beat. Then the general bases on reflectances that nobody looked
at while they were made. Takes a minute.
"""

from __future__ import annotations

from collections.abc import Iterator

from volspec.basis import SpectralBasis
from volspec.basis.make import NAMES
from volspec.spectra import light_set, reflectance_set

SIZES = (5, 7, 9)


def bases() -> Iterator[SpectralBasis]:
    """The papers' methods, trained on the 26 smooth lights, and the bases that ship."""
    lights, reflectances = light_set("smooth"), reflectance_set("training")
    for method in ("pca", "pca-sharpened"):
        for size in SIZES:
            yield SpectralBasis.fit(lights, reflectances, size=size, method=method)
    yield from map(SpectralBasis.load, NAMES)


def main() -> None:
    """Print the table."""
    test = reflectance_set("test")
    sets = {kind: light_set(kind) for kind in ("smooth", "spiky")}
    print(f"{'mean / median / 95 % / max':34s}" + "".join(f"{f'{k} lights':38s}" for k in sets))
    for position, basis in enumerate(bases()):
        reports = [basis.report(lights, test) for lights in sets.values()]
        if position == 0:  # the RGB renderer's colours are the same beside every basis
            _print("RGB product", "", [str(r.rgb_product) for r in reports])
        _print(basis.name, "componentwise", [str(r.componentwise) for r in reports])
        _print("", "exact", [str(r.exact) for r in reports])
        _print("", "linear-model", [str(r.linear_model) for r in reports])

    print("\nnever looked at before, componentwise")
    for kind in ("natural", "patches"):
        samples = reflectance_set(kind)
        for name in ("general-5", "general-7", "general-9"):
            basis = SpectralBasis.load(name)
            reports = [basis.report(lights, samples) for lights in sets.values()]
            _print(name, kind, [str(r.componentwise) for r in reports])


def _print(name: str, mode: str, cells: list[str]) -> None:
    print(f"{name:20s}{mode:14s}" + "".join(f"{cell:38s}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
