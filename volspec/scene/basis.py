"""Basis of a scene: a shipped one, its own, or its materials.

    lights, materials, transfer function -> [basis] -> SpectralBasis | MaterialBasis

A scene without ``[basis]`` gets the general basis if that reproduces its colours: in the mode
"fitted" those of all reflectances that its channels distinguish. Otherwise it gets a basis of its
own, above all for designed spectra, which oscillate and fall outside every general basis. Gratings
fall outside of small bases: unless the general one holds them, their scenes keep all bands.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import cielab, delta_E_2000
from volspec.basis import (
    DEFAULT_MODE,
    GRID_ENDINGS,
    Basis,
    MaterialBasis,
    Mode,
    SpectralBasis,
    fit_cached,
    shipped_names,
    through_samples,
    visible_white,
)
from volspec.scene.tables.specs import BasisSpec
from volspec.scene.tables.transfer import TransferSpec
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    light_set,
    white_XYZ,
)

# Largest CIEDE2000 of a scene's worst pair at which the general basis is accurate enough.
MAX_ERROR = 1.0
# Of one of a grating's stripes, whose mean is limited as that of a pair.
_MAX_STRIPE_ERROR = 5.0
# Weight of all library lights together relative to the scene's own, and the minimum weight of a
# material relative to the most visible one.
_LIBRARY_SHARE = 0.1
_MIN_USE = 0.1


@dataclass(frozen=True, slots=True)
class ChosenBasis:
    """A basis and, in words, why it was chosen."""

    basis: Basis
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class SceneSpectra:
    """Spectra that a scene trains a basis on."""

    lights: Sequence[Spectrum]
    weights: Sequence[float]  # per light
    materials: Mapping[str, Spectrum]
    use: Mapping[str, float]  # weight per material, by `use_of`
    # Materials that absorb: white seen through one has the filter's colour.
    filters: Mapping[str, Spectrum] = field(default_factory=dict)
    # Of colours that meshes may have.
    colours: Mapping[str, Spectrum] = field(default_factory=dict)
    # Paints of a room, which are seen under its own lights.
    walls: Mapping[str, Spectrum] = field(default_factory=dict)
    wall_lights: Sequence[Spectrum] = ()
    # (R, N) of each mesh's grating, towards some eyes, the highest band of each 1.
    gratings: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def reflectances(self) -> dict[str, Spectrum]:
        """Reflectances and filters whose colours the basis must reproduce, by name."""
        filters = {f"{name}'s filter": spectrum for name, spectrum in self.filters.items()}
        return {**self.materials, **filters, **self.colours}

    def stripes(self, grid: SpectralGrid) -> list[Spectrum]:
        """Return the reflectances of the gratings."""
        nm = grid.wavelengths_nm
        return [Spectrum(nm, row, name) for name, S in self.gratings.items() for row in S]

    def designed(self) -> list[str]:
        """Return the names of the spectra that are marked as designed."""
        spectra = [*self.lights, *self.reflectances.values()]
        return [spectrum.name for spectrum in spectra if spectrum.designed]


def choose_basis(
    table: BasisSpec, spectra: SceneSpectra, name: str, mode: Mode = DEFAULT_MODE
) -> ChosenBasis:
    """Return the basis of ``[basis]``; without it, the general basis if it is accurate enough.

    The general basis must be accurate in the scene's ``mode``. Raises `BasisError` if the method
    cannot be fitted to the scene's spectra.
    """
    if table.method == "materials":
        return ChosenBasis(_of_materials(table, spectra, name), 'method = "materials"')
    bands = SpectralBasis.bands(grid_of(table), table.observer_deg)
    if table.method == "bands":
        return ChosenBasis(bands, 'method = "bands"')
    shipped = general_basis(table)
    general = None if shipped is None else with_samples(shipped, spectra)
    if spectra.gratings and replace(table, grid_nm=None, observer_deg=2) == BasisSpec():
        if general is None:
            return ChosenBasis(bands, "no other holds what gratings diffract on this grid")
        lights = [*spectra.lights, *light_set("spiky", bands.grid)]
        error = grating_error(general, spectra, mode, lights)
        if not error.acceptable or _worst(general, spectra, mode)[0] > MAX_ERROR:
            return ChosenBasis(bands, f"{general.name} is off by {error}")
    if general is None:
        return ChosenBasis(train_basis(table, spectra, name), "the scene requests its own")
    designed = spectra.designed()
    distinct = mode == "fitted" and through_samples(general) is not None
    if designed and (spectra.filters or not distinct):
        reason = f"{', '.join(designed)} came from a designer"
        return ChosenBasis(train_basis(table, spectra, name), reason)
    off, where = _worst(general, spectra, mode)
    reason = f"{general.name} is off by at most ΔE00 {off:.2g} ({where})"
    if off > MAX_ERROR:
        return ChosenBasis(train_basis(table, spectra, name), reason)
    return ChosenBasis(general, reason)


def _worst(basis: SpectralBasis, spectra: SceneSpectra, mode: str) -> tuple[float, str]:
    """Return the largest CIEDE2000 of the scene's materials under its lights, and the pair."""
    errors_by_pair = []
    for reflectances, lights in (
        (spectra.reflectances, spectra.lights),
        (spectra.walls, spectra.wall_lights),
    ):
        if not reflectances:
            continue
        S = np.array([reflectance.values for reflectance in reflectances.values()])
        channels = basis.analyse(S)
        for light in lights:
            white = visible_white(white_XYZ(light, basis.observer_deg))
            approximate = cielab(channels @ basis.colour_matrix(light, mode).T, white)
            true = cielab(XYZ_from_spectra(light, S, basis.observer_deg), white)
            errors = delta_E_2000(true, approximate)
            k = int(errors.argmax())
            errors_by_pair.append((float(errors[k]), f"{list(reflectances)[k]} under {light.name}"))
    return max(errors_by_pair)


class GratingError(NamedTuple):
    """CIEDE2000 of a grating's stripes, the brightest as bright as white, under one light."""

    max: float
    mean: float
    mesh: str
    light: str

    @property
    def acceptable(self) -> bool:
        """True if a basis holds the stripes."""
        return self.mean <= MAX_ERROR and self.max <= _MAX_STRIPE_ERROR

    def __str__(self) -> str:
        return (
            f"ΔE00 {self.mean:.2g} in the mean and up to {self.max:.2g} "
            f"(stripes of {self.mesh} under {self.light})"
        )


def grating_error(
    basis: SpectralBasis, spectra: SceneSpectra, mode: str, lights: Sequence[Spectrum]
) -> GratingError:
    """Return a basis' error for the mesh and the light of which it is largest."""
    errors = []
    for light in lights:
        white = visible_white(white_XYZ(light, basis.observer_deg))
        matrix = basis.colour_matrix(light, mode)
        for mesh, S in spectra.gratings.items():
            true = XYZ_from_spectra(light, S, basis.observer_deg)
            exposure = 100.0 / max(float(true[:, 1].max()), 1e-9)
            stored = basis.analyse(S) @ matrix.T
            off = delta_E_2000(cielab(exposure * true, white), cielab(exposure * stored, white))
            errors.append(GratingError(float(off.max()), float(off.mean()), mesh, light.name))
    return max(errors)


def train_basis(table: BasisSpec, spectra: SceneSpectra, name: str) -> SpectralBasis:
    """Train a basis for the scene's materials under its own lights and the library's.

    Trained on its own lights alone it would be wrong by tens of ΔE under the next light that
    somebody tries; adding all 115 of the library at a tenth of the weight keeps their errors below
    0.2 and costs the scene's own lights a hundredth.
    """
    grid = grid_of(table)
    library = [*light_set("smooth", grid), *light_set("spiky", grid)]
    stripes = spectra.stripes(grid)
    weights = np.maximum(np.asarray(spectra.weights, dtype=np.float64), 0.0)
    weights = np.maximum(weights / max(weights.max(), 1e-12), _MIN_USE)
    library_weights = np.full(len(library), _LIBRARY_SHARE / len(library))
    return fit_cached(
        [*spectra.lights, *library],
        [*spectra.reflectances.values(), *spectra.walls.values(), *stripes],
        size=table.size,
        method=table.method,
        positive=table.positive,
        grid=grid,
        observer_deg=table.observer_deg,
        light_weights=np.concatenate([weights / weights.sum(), library_weights]),
        reflectance_weights=[
            *(spectra.use[name] for name in (*spectra.materials, *spectra.filters)),
            *(_MIN_USE for _ in spectra.colours),
            *(1.0 for _ in spectra.walls),
            *(_MIN_USE for _ in stripes),
        ],
        name=name,
        trained_on="the scene's lights and materials, and the library's lights",
    )


def update_table(table: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """Return ``[basis]`` with changes; keys that conflict with them are removed."""
    kept = {key: value for key, value in table.items() if key != "name"}
    exact = ("materials", "bands")
    if changes.get("method", kept.get("method")) not in exact:
        return kept | dict(changes) | {"train": "scene"}
    if changes.get("method") in exact:
        kept = {key: kept[key] for key in kept if key not in ("size", "positive", "train")}
    return kept | dict(changes)


def use_of(*transfers: TransferSpec | None) -> dict[str, float]:
    """Weigh the materials of transfer functions by their opacity over their values.

    The most used material has weight 1, the others at least 0.1. Fields that are not shown have no
    function.
    """
    total: defaultdict[str, float] = defaultdict(float)
    for transfer in filter(None, transfers):
        amounts: defaultdict[str, float] = defaultdict(float)
        for amount, mix in transfer.visible_mixes():
            for name, fraction in mix.items():
                amounts[name] += amount * fraction
        # Values of fields have units of their own.
        peak = max(amounts.values(), default=0.0) or 1.0
        for name, value in amounts.items():
            total[name] = max(total[name], value / peak)
    return {name: max(value, _MIN_USE) for name, value in total.items()}


def grid_of(table: BasisSpec) -> SpectralGrid:
    """Return the grid of ``[basis] grid_nm``."""
    return DEFAULT_GRID if table.grid_nm is None else SpectralGrid(*table.grid_nm)


def _of_materials(table: BasisSpec, spectra: SceneSpectra, name: str) -> MaterialBasis:
    return MaterialBasis(spectra.materials, name, grid_of(table), table.observer_deg)


def general_basis(table: BasisSpec) -> SpectralBasis | None:
    """Return the shipped basis for scenes without ``[basis]``; None if none fits the table."""
    is_default = table.train is None and table.method == "virtual-sensors"
    ending = GRID_ENDINGS.get(grid_of(table))
    if not is_default or ending is None or table.observer_deg != 2:
        return None
    name = f"general-{table.size}" + ("-positive" if table.positive else "") + ending
    return SpectralBasis.load(name) if name in shipped_names() else None


def with_samples(basis: SpectralBasis, spectra: SceneSpectra) -> SpectralBasis:
    """Return a basis with the scene's reflectances as samples; one without any stays as it is."""
    surfaces = [*spectra.reflectances.values(), *spectra.walls.values()]
    return basis.with_samples([*surfaces, *spectra.stripes(basis.grid)])
