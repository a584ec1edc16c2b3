"""Plausible reflectances for a colour, or for every colour of a picture, by several methods.

    colours, base, search -> [construct] -> scenes, command line

The tables of Otsu, Mallett and Smits are resampled to the grid and solved there, so only the
method's own error remains. The optimisers of Jakob and Meng work on the grid.

References
----------
[1] Wang, Xu & Sun (2004), "Practical Construction of Reflectances for Spectral Rendering".
[2] Smits (1999), "An RGB-to-Spectrum Conversion for Reflectances", J. Graphics Tools 4(4), 11-22.
[3] Meng, Simon, Hanika & Dachsbacher (2015), "Physically Meaningful Rendering using Tristimulus
    Colours", Computer Graphics Forum 34(4), 31-40.
[4] Otsu, Yamamoto & Hachisuka (2018), "Reproducing Spectral Reflectances From Tristimulus
    Colours", Computer Graphics Forum 37(6), 370-381.
[5] Jakob & Hanika (2019), "A Low-Dimensional Function Space for Efficient Spectral Upsampling",
    Computer Graphics Forum 38(2), 147-155.
[6] Mallett & Yuksel (2019), "Spectral Primary Decomposition for Rendering with sRGB
    Reflectance", EGSR.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError, VolspecWarning, nearest
from volspec.spectra.construct.base import ROUTES, BaseSpectra, MadeReflectances, base_spectra
from volspec.spectra.construct.colours import XYZ_from_linear_sRGB, checked_XYZ, colour_XYZ
from volspec.spectra.construct.search import (
    Tetrahedra,
    clip_to_hull,
    locate_tetrahedra,
    search_octants,
    select_distinct,
    smoothest_reflectances,
)
from volspec.spectra.datasets import Observer, colour_matching_functions, colour_science
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.library.lights import light as named_light
from volspec.spectra.photometry import XYZ_from_spectra, white_XYZ
from volspec.spectra.spectrum import Spectrum, extended_band_means

Array = NDArray[np.float64]


def recover_reflectances(method: str, XYZ: Array, light: Spectrum, observer_deg: Observer) -> Array:
    """Return (n, N) reflectances of (n, 3) XYZ by a method of `RECOVERIES`, clipped to 0 to 1.

    Raises SpectrumError if an optimiser does not converge or the tables do not cover the grid.
    """
    if not len(XYZ):
        return np.empty((0, light.values.size))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.clip(RECOVERIES[method](XYZ, light, observer_deg), 0.0, 1.0)


def _otsu(XYZ: Array, light: Spectrum, observer_deg: Observer) -> Array:
    """Fit the mean and three basis functions of each colour's cluster; one 3 x 3 system each."""
    recovery = colour_science().recovery
    shape = recovery.SPECTRAL_SHAPE_OTSU2018
    dataset = recovery.Dataset_Otsu2018(
        shape,
        recovery.BASIS_FUNCTIONS_OTSU2018,
        recovery.CLUSTER_MEANS_OTSU2018,
        recovery.SELECTOR_ARRAY_OTSU2018,
    )
    w = shape.wavelengths
    Q = XYZ_from_spectra(light, np.eye(light.values.size), observer_deg).T
    values = np.empty((len(XYZ), light.values.size))
    for row, colour in enumerate(XYZ):
        total = colour.sum()
        xy = colour[:2] / total if total > 0 else np.full(2, 1 / 3)
        basis, mean = dataset.cluster(xy)
        resample = extended_band_means(w, np.column_stack([mean, basis.T]), light.grid)
        mean, basis = resample[:, 0], resample[:, 1:]
        values[row] = mean + basis @ np.linalg.solve(Q @ basis, colour - Q @ mean)
    return values


def _mallett(XYZ: Array, light: Spectrum, observer_deg: Observer) -> Array:
    recovery = colour_science().recovery
    basis = recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    return (
        _linear_sRGB(XYZ, light, observer_deg)
        @ extended_band_means(basis.wavelengths, basis.values, light.grid).T
    )


def _smits(XYZ: Array, light: Spectrum, observer_deg: Observer) -> Array:
    recovery = colour_science().recovery
    spectra = [recovery.RGB_to_sd_Smits1999(rgb) for rgb in _linear_sRGB(XYZ, light, observer_deg)]
    columns = np.column_stack([spectrum.values for spectrum in spectra])
    return extended_band_means(spectra[0].wavelengths, columns, light.grid).T


def _linear_sRGB(XYZ: Array, light: Spectrum, observer_deg: Observer) -> Array:
    white = XYZ_from_spectra(light, np.ones(light.values.size), observer_deg)
    return np.clip(XYZ @ np.linalg.inv(XYZ_from_linear_sRGB(white)).T, 0.0, 1.0)


def _optimiser(name: str) -> Callable[[Array, Spectrum, Observer], Array]:
    def recover(XYZ: Array, light: Spectrum, observer_deg: Observer) -> Array:
        colour = colour_science()
        # Exact wavelengths: rounded ones would have another spectral shape.
        w = light.wavelengths_nm
        Q = colour_matching_functions(light.grid, observer_deg)
        cmfs = colour.MultiSpectralDistributions(Q.T, w)
        lamp = colour.SpectralDistribution(light.values, w)
        method: Any = getattr(colour.recovery, name)
        rows = []
        for triple in XYZ:
            try:
                rows.append(method(triple / 100.0, cmfs, lamp).values)
            except RuntimeError as error:
                raise SpectrumError(
                    f"colour X Y Z {triple[0]:g} {triple[1]:g} {triple[2]:g}: {name} does not "
                    "converge; use another method, such as delaunay",
                    code="impossible",
                ) from error
        return np.array(rows)

    return recover


RECOVERIES: dict[str, Callable[[Array, Spectrum, Observer], Array]] = {
    "otsu-2018": _otsu,
    "jakob-2019": _optimiser("XYZ_to_sd_Jakob2019"),
    "meng-2015": _optimiser("XYZ_to_sd_Meng2015"),
    "mallett-2019": _mallett,
    "smits-1999": _smits,
}
"""Functions of (n, 3) XYZ, a light and an observer that return (n, N), by method."""


_ROUTE = {name: number for number, name in enumerate(ROUTES)}
METHODS = ("delaunay", "tetrahedron", "smoothest", *RECOVERIES)
"""Methods of `reflectances_from_colours`."""


def reflectance_from_colour(
    colour: str | ArrayLike,
    method: str = "delaunay",
    light: str | Spectrum = "D65",
    *,
    observer_deg: Observer = 2,
    grid: SpectralGrid = DEFAULT_GRID,
    base: BaseSpectra | None = None,
) -> Spectrum:
    """Return a plausible reflectance that has a colour under a light.

    Parameters
    ----------
    colour : str or (3,) array_like
        ``"#c08040"``, a CSS Color 3 name, or X Y Z with Y = 100 for white, as three numbers or as
        text. sRGB colours are adapted from sRGB's white to the light's.
    method, light, observer_deg, grid, base
        See `reflectances_from_colours`.

    Returns
    -------
    Spectrum
        0 to 1 on the grid, with the notes ``constructed`` (one of `ROUTES`), ``colour``, and
        ``mixed from`` or ``extended from`` (the base spectra and their weights).

    Raises
    ------
    SpectrumError
        If the colour is unknown or impossible (`checked_XYZ`), or the method or light is unknown.

    Warns
    -----
    VolspecWarning
        If no reflectance within 0 to 1 has the colour; one with the nearest colour is returned.

    Examples
    --------
    >>> paint = reflectance_from_colour("#c08040")
    >>> paint.notes["constructed"]
    'delaunay'
    """
    lamp = _lamp(light, grid)
    XYZ = colour_XYZ(colour, white_XYZ(lamp, observer_deg))
    spectra = reflectances_from_colours(
        XYZ, method, lamp, observer_deg=observer_deg, grid=grid, base=base
    )
    name = colour.strip() if isinstance(colour, str) else f"X Y Z {_words(XYZ)}"
    return constructed_spectrum(spectra, name, XYZ, lamp, method, observer_deg)


def constructed_spectrum(
    spectra: MadeReflectances,
    name: str,
    XYZ: Array,
    light: Spectrum,
    method: str,
    observer_deg: Observer = 2,
) -> Spectrum:
    """Return the reflectance made for one colour as a spectrum with notes and a name.

    Warns as `reflectance_from_colour` does.
    """
    route, lamp = ROUTES[int(spectra.route)], light.name or "a light"
    notes = {
        "spectral quantity": "reflectance",
        "constructed": _method(method) if route == "recovered" else route,
        "colour": f"X Y Z {_words(XYZ)} under {lamp}, {observer_deg} degrees",
    }
    if mix := spectra.mix():
        how = "extended" if route == "extended" else "mixed"
        notes[f"{how} from"] = ", ".join(f"{weight:.4f} {part}" for part, weight in mix.items())
    if route == "nearest":
        # stacklevel: the caller of `reflectance_from_colour` is two calls up.
        warnings.warn(
            f"colour {name!r}: no reflectance within 0 to 1 is X Y Z {_words(XYZ)} under {lamp}; "
            f"using the nearest, {_words(XYZ_from_spectra(light, spectra.values, observer_deg))}",
            VolspecWarning,
            stacklevel=3,
        )
    return Spectrum(light.wavelengths_nm, spectra.values, name, notes)


def _words(XYZ: Array) -> str:
    return " ".join(f"{number:.6g}" for number in XYZ)


def reflectances_from_colours(
    XYZ: ArrayLike,
    method: str = "delaunay",
    light: str | Spectrum = "D65",
    *,
    observer_deg: Observer = 2,
    grid: SpectralGrid = DEFAULT_GRID,
    base: BaseSpectra | None = None,
    progress: Callable[[float], None] | None = None,
) -> MadeReflectances:
    """Return plausible reflectances for a palette or a whole picture of colours at once.

    Parameters
    ----------
    XYZ : (..., 3) array_like
        Colours of surfaces under the light, Y = 100 for white.
    method : str
        - ``delaunay``: mixed from the four base spectra of the Delaunay tetrahedron in XYZ
          around the colour (eq. 7, 8 of [1]). For a colour outside of the hull, the mixture on
          the hull towards grey, extended by the smoothest difference; so neighbouring colours
          have similar spectra, also across the hull.
        - ``tetrahedron``: the search of [1], the nearest base colour in each octant around the
          colour; ``delaunay`` if its five tetrahedra miss the colour.
        - ``smoothest``: the reflectance within 0 to 1 with the smallest second differences that
          has the colour, or the nearest possible colour.
        - ``otsu-2018``, ``jakob-2019``, ``meng-2015``, ``mallett-2019``, ``smits-1999``:
          recovered with colour-science, clipped to 0 to 1; the colour may be off.
    light : str or Spectrum
        The colours' light; a name for `light`.
    observer_deg : Observer
    grid : SpectralGrid
        N bands. The light is resampled to this grid.
    base : BaseSpectra, optional
        Spectra to mix, on the same grid; by default `base_spectra`.
    progress : function of a fraction 0 to 1, optional
        Called while colours outside of the base spectra's hull are solved, about 0.3 ms each;
        every colour is solved once, however many pixels have it.

    Returns
    -------
    MadeReflectances
        Values (..., N) within 0 to 1, and the origin of each.

    Raises
    ------
    SpectrumError
        If a colour is impossible (`checked_XYZ`), the method or light is unknown, or the base
        is on another grid.

    Examples
    --------
    >>> made = reflectances_from_colours([[20, 21, 22], [41.2, 21.3, 2.0]])
    >>> made.values.shape, made.counts()
    ((2, 81), {'delaunay': 1, 'extended': 1})
    """
    method_name = _method(method)
    lamp = _lamp(light, grid)
    colours = checked_XYZ(XYZ, white_XYZ(lamp, observer_deg))
    base = base_spectra(grid) if base is None else base
    if base.grid != grid:
        raise SpectrumError(
            f"base spectra are on {base.grid}, not {grid}; use the same grid", code="conflict"
        )
    rows = colours.reshape(-1, 3)
    route = np.full(len(rows), _ROUTE["smoothest"], dtype=np.uint8)
    vertices = np.full((len(rows), 4), -1, dtype=np.intp)
    weights = np.zeros((len(rows), 4))
    if method_name in RECOVERIES:
        values = recover_reflectances(method_name, rows, lamp, observer_deg)
        route[:] = _ROUTE["recovered"]
    else:
        if method_name != "smoothest" and len(rows):
            white, selected, mesh = _mesh(base, lamp.values.tobytes(), observer_deg)
            route, vertices, weights = _surround(rows / white, mesh, method_name == "tetrahedron")
            vertices = np.where(vertices >= 0, selected[vertices], -1)
        values = _mix(base.values, vertices, weights)
        outside = route >= _ROUTE["extended"]
        if outside.any():
            Q = XYZ_from_spectra(lamp, np.eye(grid.size), observer_deg).T
            unique, first, inverse = np.unique(
                rows[outside], axis=0, return_index=True, return_inverse=True
            )
            solved, reached = smoothest_reflectances(unique, Q, values[outside][first], progress)
            inverse = inverse.ravel()
            values[outside] = solved[inverse]
            missed = np.flatnonzero(outside)[~reached[inverse]]
            route[missed], vertices[missed], weights[missed] = _ROUTE["nearest"], -1, 0.0
    shape = colours.shape[:-1]
    return MadeReflectances(
        values.reshape(*shape, grid.size),
        route.reshape(shape),
        vertices.reshape(*shape, 4),
        weights.reshape(*shape, 4),
        base,
    )


def _method(method: object) -> str:
    """Normalise a method's name: ``Otsu 2018`` is ``otsu-2018``."""
    word = "-".join(str(method).casefold().replace("_", "-").split())
    if word not in METHODS:
        raise SpectrumError(
            f"reflectance method {method!r} is unknown; {nearest(word, METHODS)}"
            f"choose {', '.join(METHODS)}",
            code="unknown",
        )
    return word


def _lamp(light: str | Spectrum, grid: SpectralGrid) -> Spectrum:
    return light.on(grid) if isinstance(light, Spectrum) else named_light(light, grid)


@lru_cache(maxsize=8)
def _mesh(
    base: BaseSpectra, power: bytes, observer_deg: Observer
) -> tuple[Array, NDArray[np.intp], Tetrahedra]:
    """Return the light's white, the base spectra to search, and their colours relative to it.

    Cached for palettes that are constructed colour by colour.
    """
    lamp = Spectrum(base.grid.wavelengths_nm, np.frombuffer(power))
    # A light's X or Z may be 0: divide by a millionth of white instead.
    white = np.maximum(white_XYZ(lamp, observer_deg), 1e-4)
    points = XYZ_from_spectra(lamp, base.values, observer_deg) / white
    selected = select_distinct(points)
    return white, selected, Tetrahedra.of(points[selected])


def _surround(
    colours: Array, mesh: Tetrahedra, octants_first: bool
) -> tuple[NDArray[np.uint8], NDArray[np.intp], Array]:
    """Return route, vertices and weights of every colour's mixture, or of the one to extend."""
    n = len(colours)
    route = np.full(n, _ROUTE["tetrahedron"], dtype=np.uint8)
    vertices, weights = np.full((n, 4), -1, dtype=np.intp), np.zeros((n, 4))
    if octants_first:
        vertices, weights = search_octants(mesh.points, colours)
    unset = vertices[:, 0] < 0
    vertices[unset], weights[unset] = locate_tetrahedra(mesh, colours[unset])
    route[unset] = _ROUTE["delaunay"]
    unset = vertices[:, 0] < 0
    vertices[unset], weights[unset] = locate_tetrahedra(mesh, clip_to_hull(mesh, colours[unset]))
    route[unset] = _ROUTE["extended"]
    # Without greys in the base, lines do not start inside of its hull.
    route[vertices[:, 0] < 0] = _ROUTE["smoothest"]
    return route, vertices, weights


def _mix(base: Array, vertices: NDArray[np.intp], weights: Array) -> Array:
    """Return (n, N) weighted sums of base spectra, eq. 8 of [1]; zeros if nothing is mixed."""
    from scipy.sparse import csr_matrix

    n = len(vertices)
    starts = np.arange(0, 4 * n + 1, 4)
    columns = np.maximum(vertices, 0).ravel()
    matrix = csr_matrix((weights.ravel(), columns, starts), shape=(n, len(base)))
    return np.clip(matrix @ base, 0.0, 1.0)
