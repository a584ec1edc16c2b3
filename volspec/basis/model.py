"""A spectral basis: maps N bands to m channels that multiply componentwise, light by surface.

    spectra -> [basis] -> transfer function, raycast, relight

A (m x N) analyses spectra, B (N x m) synthesises them, D (3 x m) turns the channels of a
colour signal into XYZ. Flat white has channels of ones, so the result of a raycast is the
picture under flat white light.

References
----------
[1] Bergner, Drew, Moeller (2009), "A Tool to Create Illuminant and Reflectance Spectra for
    Light-Driven Graphics and Visualization", ACM TOG 28(1), sections 2.2-2.3.
[2] Drew, Finlayson (2003), "Multispectral processing without spectra", JOSA A 20(7).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis import display, storage
from volspec.basis.base import (
    require_channels,
    require_materials,
    require_matrices,
    require_observer,
    require_reflective,
    require_samples,
    require_text,
)
from volspec.basis.report import ReportedBasis
from volspec.errors import BasisError
from volspec.spectra import (
    DEFAULT_GRID,
    Observer,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light_power,
    stack,
    white_XYZ,
)
from volspec.spectra.library import reflectance_set

Spectra = Spectrum | Sequence[Spectrum] | ArrayLike

_MATRICES = ("analysis", "synthesis", "XYZ_from_channels")
# Weight of the library's training set next to a basis' own samples.
_LIBRARY_WEIGHT = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class SpectralBasis(ReportedBasis):
    """Analysis, synthesis and display matrices of one basis; read-only.

    Parameters
    ----------
    name, method : str
        Name, and fitting method.
    grid : SpectralGrid
        The N bands.
    analysis : (m, N) array
        A; its rows sum to 1.
    synthesis : (N, m) array
        B, with A B = I. B 1 = 1 for ``virtual-sensors`` and ``reduced-rank``; approximately so for
        the principal-component methods.
    XYZ_from_channels : (3, m) array
        D; scaled so that flat light (ones) on a perfect diffuser has Y near 100.
    trained_on : str
        Description of the lights and reflectances.
    observer_deg : Observer
        Observer of D: CIE 1931 2 degrees or CIE 1964 10 degrees.
    samples : (K, N) array, optional
        Reflectances, such as a scene's, whose colours `fitted_matrix` gives best, before those of
        the library's training set. None, as in files of earlier versions: the mode ``"fitted"`` is
        ``"componentwise"``.

    Raises
    ------
    BasisError
        If shapes do not match, a value is not finite, flat white changes, A B is not the identity,
        the observer is unknown, or a name is not text.
    """

    name: str
    method: str
    grid: SpectralGrid
    analysis: NDArray[np.float64]
    synthesis: NDArray[np.float64]
    XYZ_from_channels: NDArray[np.float64]
    trained_on: str = ""
    observer_deg: Observer = 2
    samples: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        for field in ("name", "method", "trained_on"):
            require_text(getattr(self, field), f"spectral basis: {field}")
        observer_deg = require_observer(self.observer_deg, f"basis {self.name!r}")
        object.__setattr__(self, "observer_deg", observer_deg)
        matrices, label = {name: getattr(self, name) for name in _MATRICES}, f"basis {self.name!r}"
        for field, matrix in require_matrices(matrices, self.grid, label).items():
            object.__setattr__(self, field, matrix)
        samples = require_samples(self.samples, self.grid, f"{label}: samples")
        object.__setattr__(self, "samples", samples)

    def __repr__(self) -> str:
        bands = f"{self.grid.size} bands"
        return f"SpectralBasis({self.name!r}, {self.method}, {self.size} channels, {bands})"

    @property
    def size(self) -> int:
        """Number of channels, m."""
        return int(self.analysis.shape[0])

    @property
    def white(self) -> NDArray[np.float64]:
        """(m,) channels of the perfect diffuser: ones."""
        return np.ones(self.size)

    def analyse(self, spectra: Spectra) -> NDArray[np.float64]:
        """Return the channels of lights or reflectances.

        Parameters
        ----------
        spectra : Spectrum, list of Spectrum, or (..., N) array
            Spectra are resampled to the basis' grid; arrays must be on it.

        Returns
        -------
        (m,) or (..., m) float64
            Linear in the spectrum; ones for flat white.

        Raises
        ------
        SpectrumError
            If a spectrum does not cover the grid or an array has another length.
        """
        return stack(spectra, self.grid) @ self.analysis.T

    def surface_channels(self, surfaces: Sequence[Spectrum]) -> NDArray[np.float64]:
        """Return (K, m) channels of reflectances, analysed."""
        return self.analyse(surfaces)

    def channels_for_materials(self, materials: Mapping[str, Spectrum]) -> NDArray[np.float64]:
        """Return (K, m) channels of a transfer function's materials, in the mapping's order.

        Raises
        ------
        BasisError, SpectrumError
            If there are none, one is fluorescent, or does not cover the grid.
        """
        require_materials(materials, f"basis {self.name!r}")
        require_reflective(materials, self.name)
        return self.analyse(list(materials.values())).reshape(-1, self.size)

    def synthesise(self, coefficients: ArrayLike) -> NDArray[np.float64]:
        """Convert (..., m) channels to (..., N) spectra, the basis' best estimate."""
        return require_channels(self, coefficients) @ self.synthesis.T

    def colour_matrix(
        self,
        light: Spectrum,
        mode: str = display.DEFAULT_MODE,
        seen_through: Spectrum | None = None,
    ) -> NDArray[np.float64]:
        """Return the (3, m) matrix from a picture's channels to XYZ under a light.

        Its product with `white` is the light's white, Y = 100, up to rounding.

        Parameters
        ----------
        light : Spectrum
        mode : {"fitted", "componentwise", "exact", "linear-model"}
            ``fitted_matrix(light)``, the light's own; ``display_matrix(light) * analyse(light)``,
            the papers' factor model; ``light_matrix(light)``, without a factor model; or D R(e),
            the product inside the subspace that the componentwise product approximates ([1] eq. 7).
        seen_through : Spectrum, optional
            Filter in the eye's path, to which reflected light is as the light through it; the white
            without it has Y = 100.

        Raises
        ------
        BasisError, SpectrumError
            If the mode is unknown; see `display_matrix`.
        """
        display.require_mode(mode)
        if seen_through is not None:
            E, V = light_power(light, self.grid), self._Q[1]
            passed = E * seen_through.on(self.grid).values
            fraction = float(V @ passed) / float(V @ E)
            if not fraction > 0:
                return np.zeros((3, self.size))
            return fraction * self.colour_matrix(Spectrum(self.grid.wavelengths_nm, passed), mode)
        if mode == "exact":
            return self.light_matrix(light)
        if mode == "fitted" and self.samples is not None:
            return self.fitted_matrix(light)
        E = light_power(light, self.grid)
        e = self.analysis @ E
        if mode != "linear-model":
            return display.display_matrix(self.XYZ_from_channels, e, E, self._Q) * e
        R = self.illumination_matrix(light)
        return display.display_matrix(self.XYZ_from_channels @ R, self.white, E, self._Q)

    def display_matrix(self, light: Spectrum) -> NDArray[np.float64]:
        """Return K (3, m) with XYZ = K (e * c), e = analyse(light), c the reflectance's channels.

        K is D with each row scaled so that the light's white is exactly the XYZ of its full
        spectrum, Y = 100. The stretch is limited to a factor of two (lights with little X or Z),
        and the rest is added in proportion to Y; a row below a thousandth of Y follows Y entirely.
        K varies continuously with the light, but not linearly: pictures under two lights add up to
        the picture under both only approximately.

        Raises
        ------
        SpectrumError
            If the light has negative power or no luminous energy, or does not cover the grid.
        """
        E = light_power(light, self.grid)
        return display.display_matrix(self.XYZ_from_channels, self.analysis @ E, E, self._Q)

    def light_matrix(self, light: Spectrum) -> NDArray[np.float64]:
        """Return P_E = kappa Q diag(E) B, (3, m): XYZ = P_E c without a factor model.

        Linear in the light if B 1 = 1, so that lights add up. With ``pca`` and ``pca-sharpened``
        its rows are stretched as in `display_matrix`, so that white is exact. Errors are those of
        `display_matrix`.
        """
        E, Q = light_power(light, self.grid), self._Q
        kappa = 100.0 / (Q[1] @ E)
        matrix = kappa * ((Q * E) @ self.synthesis)
        return display.white_exact(matrix, self.white, kappa * (Q @ E))

    def fitted_matrix(self, light: Spectrum) -> NDArray[np.float64]:
        """Return the (3, m) matrix with the best colours of the samples under a light.

        Any componentwise product is, for one light, a matrix on the surface's channels; here every
        entry is free (`volspec.basis.display.fitted_matrix`). White is exact; fewer samples than
        channels, and their mixtures, are within CIEDE2000 .01 under the library's lights. Cached.

        Raises
        ------
        BasisError, SpectrumError
            If the basis has no samples; see `display_matrix`.
        """
        return _fitted_matrix(self, light_power(light, self.grid).tobytes())

    def with_samples(self, spectra: Iterable[Spectrum]) -> SpectralBasis:
        """Return the basis with other samples; one of an earlier version, without any, stays.

        Errors are those of `SpectralBasis`; SpectrumError if one does not cover the grid.
        """
        if self.samples is None:
            return self
        return replace(
            self, samples=np.array([spectrum.on(self.grid).values for spectrum in spectra])
        )

    def illumination_matrix(self, light: Spectrum) -> NDArray[np.float64]:
        """Return R(e), (m, m), from reflectance to colour-signal channels, inside the subspace.

        R(e)_ij = sum_k A_i (B_j * B_k) e_k ([1] eq. 7, A = B^+), on the light's scale. Linear in
        the light; diagonal if the componentwise product is exact. Errors are those of
        `display_matrix`.
        """
        e = self.analysis @ light_power(light, self.grid)
        return self.analysis @ (self.synthesis * (self.synthesis @ e)[:, None])

    @classmethod
    def fit(
        cls,
        lights: Sequence[Spectrum] | ArrayLike,
        reflectances: Sequence[Spectrum] | ArrayLike,
        size: int = 7,
        method: str = "virtual-sensors",
        positive: bool = False,
        *,
        grid: SpectralGrid = DEFAULT_GRID,
        name: str = "",
        trained_on: str = "",
        observer_deg: Observer = 2,
        smoothness: float | None = None,
        restarts: int | None = None,
        light_weights: ArrayLike | None = None,
        reflectance_weights: ArrayLike | None = None,
    ) -> SpectralBasis:
        """Fit a basis to the lights and reflectances it will be used with.

        Parameters
        ----------
        lights, reflectances : list of Spectrum or (K, N) array
            Arrays must be on ``grid``.
        size : int
            Channels m.
        method : {"virtual-sensors", "pca", "pca-sharpened", "reduced-rank"}
            See `volspec.basis.fit`.
        positive : bool
            Constrain A >= 0, so that reflectances have channels in 0..1 (``virtual-sensors``).
        observer_deg : Observer
            Observer of the colours.
        smoothness : float, optional
            Weight of the second-difference penalty on A's rows (``virtual-sensors``).
        restarts : int, optional
            Number of perturbed starts in addition to the regular one; deterministic
            (``virtual-sensors``).
        light_weights, reflectance_weights : (J,) and (K,) array, optional
            Weight of each light's and each reflectance's errors; above 0, on any scale.
            Equal by default.

        Raises
        ------
        BasisError
            If the method is unknown, the data do not determine this many channels, weights do not
            match, or a light has no energy.
        """
        # Imported late: a stored basis needs no fitter.
        from volspec.basis.fit import fit_basis
        from volspec.basis.fit.training import training_set

        training = training_set(
            lights,
            reflectances,
            grid,
            observer_deg=require_observer(observer_deg, "fit"),
            light_weights=light_weights,
            reflectance_weights=reflectance_weights,
        )
        A, B, D = fit_basis(
            training, size, method, positive=positive, smoothness=smoothness, restarts=restarts
        )
        return cls(
            name=name if name != "" else f"{method}-{size}",
            method=method,
            grid=grid,
            analysis=A,
            synthesis=B,
            XYZ_from_channels=D,
            trained_on=trained_on if trained_on != "" else training.label,
            observer_deg=observer_deg,
            samples=training.S,
        )

    @classmethod
    def bands(cls, grid: SpectralGrid = DEFAULT_GRID, observer_deg: Observer = 2) -> SpectralBasis:
        """Return the basis without reduction: every band is a channel, and every product is exact.

        Reference for other bases, if a picture can be cast with this many channels.
        """
        require_observer(observer_deg, "bands")
        Q = colour_matching_functions(grid, observer_deg)
        return cls(
            name=f"{grid.size} bands",
            method="bands",
            grid=grid,
            analysis=np.eye(grid.size),
            synthesis=np.eye(grid.size),
            XYZ_from_channels=100.0 * Q / Q[1].sum(),
            observer_deg=observer_deg,
        )

    def _numbers(self) -> dict[str, Any]:
        numbers = {name: getattr(self, name).tolist() for name in _MATRICES}
        if self.samples is not None:
            numbers["samples"] = self.samples.tolist()
        return numbers

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> SpectralBasis:
        """Invert `to_dict`.

        Raises
        ------
        BasisError
            If the data are not a basis or have another version or kind, a field is missing or
            wrong, or the numbers do not match the fingerprint.
        """
        if storage.is_material_basis(data):
            raise BasisError(
                "this is a basis of materials; use volspec.load_basis or volspec.MaterialBasis",
                code="type",
            )
        names = ("name", "method", "trained_on", *_MATRICES)
        head = storage.head_from_dict(data, names)
        values = {name: data[name] for name in names}
        basis = cls(**head, **values, samples=data.get("samples"))
        basis._require_unedited(data)
        return basis

    @property
    def fingerprint(self) -> str:
        """Short hash of the grid, the observer and the matrices, but not the name or the samples.

        Unchanged by save and load.
        """
        digest = hashlib.sha256(f"{self.grid}, {self.observer_deg} degrees".encode())
        for array in (getattr(self, name) for name in _MATRICES):
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()[:12]

    @property
    def _Q(self) -> NDArray[np.float64]:
        return colour_matching_functions(self.grid, self.observer_deg)


@lru_cache(maxsize=32)
def training_reflectances(grid: SpectralGrid) -> NDArray[np.float64]:
    return reflectance_set("training", grid)


# Lights of a session: a slider moves their weights, not their matrices.
@lru_cache(maxsize=64)
def _fitted_matrix(basis: SpectralBasis, power: bytes) -> NDArray[np.float64]:
    """Return `SpectralBasis.fitted_matrix` under a light of (N,) power, as bytes; cached."""
    if basis.samples is None:
        raise BasisError(
            f"basis {basis.name!r} has no samples to fit a light's matrix to; fit the basis again",
            code="missing",
        )
    light = Spectrum(basis.grid.wavelengths_nm, np.frombuffer(power))
    samples, library = basis.samples, training_reflectances(basis.grid)
    S = np.concatenate([samples, library])
    library_weight = _LIBRARY_WEIGHT if len(samples) else 1.0
    weights = np.repeat([1.0, library_weight], [len(samples), len(library)])
    weights /= np.repeat([max(len(samples), 1), len(library)], [len(samples), len(library)])
    matrix = display.fitted_matrix(
        basis.analyse(S),
        XYZ_from_spectra(light, S, basis.observer_deg),
        weights,
        white_XYZ(light, basis.observer_deg),
        basis.light_matrix(light),
    )
    matrix.flags.writeable = False
    return matrix
