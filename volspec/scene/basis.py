"""Basis of a scene: a shipped one, its own, or its materials.

    lights, materials, transfer function -> [basis] -> SpectralBasis | MaterialBasis

Spectra made by a designer oscillate and fall outside every general basis. A scene that says
nothing is therefore given the general basis only where that holds its colours, and its own
where it does not.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from volspec.appearance.models.cielab import cielab, delta_E_2000
from volspec.basis import Basis, MaterialBasis, SpectralBasis
from volspec.basis.display import visible_white
from volspec.basis.fit_cache import fit_cached
from volspec.basis.storage import shipped_names
from volspec.scene.specs import BasisSpec
from volspec.scene.transfer import TransferSpec
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    light_set,
    white_XYZ,
)

# Above this CIEDE2000 of its worst pair a general basis is not good enough for a scene.
LARGEST_ERROR = 1.0
# What all lights of the library together count against the scene's own, and the least that a
# material counts against the one most seen.
_LIBRARY_SHARE = 0.1
_LEAST_USE = 0.1


@dataclass(frozen=True, slots=True)
class ChosenBasis:
    """A basis and, in words, why it was taken."""

    basis: Basis
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class SceneSpectra:
    """Spectra that a scene trains a basis on."""

    lights: Sequence[Spectrum]
    weights: Sequence[float]  # of the lights
    materials: Mapping[str, Spectrum]
    use: Mapping[str, float]  # of each material, by `use_of`
    # Of materials that absorb: white seen through one has the filter's colour.
    filters: Mapping[str, Spectrum] = field(default_factory=dict)

    @property
    def reflectances(self) -> dict[str, Spectrum]:
        """All whose colours the basis must hold, filters among them, by what they are called."""
        filters = {f"{name}'s filter": spectrum for name, spectrum in self.filters.items()}
        return {**self.materials, **filters}

    def designed(self) -> list[str]:
        """Names of the spectra whose file says that a designer made them."""
        spectra = [*self.lights, *self.reflectances.values()]
        return [spectrum.name for spectrum in spectra if spectrum.designed]


def choose_basis(
    table: BasisSpec, spectra: SceneSpectra, name: str, mode: str = "componentwise"
) -> ChosenBasis:
    """Return the basis of ``[basis]``; left out, the general one if it is accurate enough.

    The scene's ``mode`` is what the general basis must be accurate in. Raises `BasisError` if the
    method cannot be fitted to the scene's spectra.
    """
    if table.method == "materials":
        return ChosenBasis(_of_materials(table, spectra, name), 'method = "materials"')
    general = _general(table)
    if general is None:
        return ChosenBasis(train_basis(table, spectra, name), "the scene asks for its own")
    designed = spectra.designed()
    if designed:
        reason = f"{', '.join(designed)} came from a designer"
        return ChosenBasis(train_basis(table, spectra, name), reason)
    off, where = _worst(general, spectra, mode)
    reason = f"{general.name} is off by at most ΔE00 {off:.2g} ({where})"
    if off > LARGEST_ERROR:
        return ChosenBasis(train_basis(table, spectra, name), reason)
    return ChosenBasis(general, reason)


def _worst(basis: SpectralBasis, spectra: SceneSpectra, mode: str) -> tuple[float, str]:
    """The largest CIEDE2000 of the scene's materials under its lights, and where it is."""
    reflectances = spectra.reflectances
    S = np.array([reflectance.values for reflectance in reflectances.values()])
    channels = basis.analyse(S)
    found = []
    for light in spectra.lights:
        white = visible_white(white_XYZ(light, basis.observer_deg))
        shown = cielab(channels @ basis.colour_matrix(light, mode).T, white)
        true = cielab(XYZ_from_spectra(light, S, basis.observer_deg), white)
        errors = delta_E_2000(true, shown)
        k = int(errors.argmax())
        found.append((float(errors[k]), f"{list(reflectances)[k]} under {light.name}"))
    return max(found)


def train_basis(table: BasisSpec, spectra: SceneSpectra, name: str) -> SpectralBasis:
    """A basis for the scene's materials under its own lights, and under any of the library.

    Trained on its own lights alone it would be wrong by tens of ΔE under the next one that
    somebody tries; all 115 of the library at a tenth of the weight hold those below 0.2 and
    cost the scene's own lights a hundredth.
    """
    grid = grid_of(table)
    library = [*light_set("smooth", grid), *light_set("spiky", grid)]
    own = np.maximum(np.asarray(spectra.weights, dtype=np.float64), 0.0)
    own = np.maximum(own / max(own.max(), 1e-12), _LEAST_USE)
    shares = np.full(len(library), _LIBRARY_SHARE / len(library))
    return fit_cached(
        [*spectra.lights, *library],
        list(spectra.reflectances.values()),
        size=table.size,
        method=table.method,
        positive=table.positive,
        grid=grid,
        observer_deg=table.observer_deg,
        light_weights=np.concatenate([own / own.sum(), shares]),
        reflectance_weights=[spectra.use[name] for name in (*spectra.materials, *spectra.filters)],
        name=name,
        trained_on="the scene's lights and materials, and the library's lights",
    )


def retrained(table: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """``[basis]`` with other settings; what the file says and they rule out is left out."""
    kept = {key: value for key, value in table.items() if key != "name"}
    if changes.get("method", kept.get("method")) != "materials":
        return kept | dict(changes) | {"train": "scene"}
    if changes.get("method") == "materials":
        kept = {key: kept[key] for key in kept if key not in ("size", "positive", "train")}
    return kept | dict(changes)


def use_of(transfer: TransferSpec) -> dict[str, float]:
    """Weigh the materials of a transfer function by their opacity over their values.

    The most used one has 1, none less than 0.1.
    """
    total: defaultdict[str, float] = defaultdict(float)
    for amount, shares in transfer.seen():
        for name, share in shares.items():
            total[name] += amount * share
    most = max(total.values(), default=0.0) or 1.0
    return {name: max(value / most, _LEAST_USE) for name, value in total.items()}


def grid_of(table: BasisSpec) -> SpectralGrid:
    """The grid that ``[basis] grid_nm`` asks for."""
    return DEFAULT_GRID if table.grid_nm is None else SpectralGrid(*table.grid_nm)


def _of_materials(table: BasisSpec, spectra: SceneSpectra, name: str) -> MaterialBasis:
    return MaterialBasis(spectra.materials, name, grid_of(table), table.observer_deg)


def _general(table: BasisSpec) -> SpectralBasis | None:
    """The shipped basis that a scene without wishes of its own would take."""
    plain = table.train is None and table.method == "virtual-sensors"
    if not plain or grid_of(table) != DEFAULT_GRID or table.observer_deg != 2:
        return None
    name = f"general-{table.size}" + ("-positive" if table.positive else "")
    return SpectralBasis.load(name) if name in shipped_names() else None
