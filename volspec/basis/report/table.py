"""The error table of a basis over several classes of lights, for people and machines.

basis, {class: lights}, reflectances -> [table] -> terminal, JSON, figure
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from volspec.basis.report.errors import (
    ADAPTATION,
    BasisReport,
    ErrorSummary,
    Reflectances,
    WorstPair,
    report,
)
from volspec.errors import BasisError
from volspec.spectra.library import light_set
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

CLASSES = ("smooth", "spiky")
"""The classes of the library's lights."""


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """A basis' reports by class of lights.

    Parameters
    ----------
    name, method, trained_on, fingerprint : str
    size, observer_deg : int
    grid_nm : (start, stop, step)
    measured_on : str
        The reflectances, in words.
    classes : {name: BasisReport}
        ``smooth`` and ``spiky``, a scene's own as ``scene``.
    """

    name: str
    method: str
    size: int
    trained_on: str
    fingerprint: str
    observer_deg: int
    grid_nm: tuple[float, float, float]
    measured_on: str
    classes: Mapping[str, BasisReport]

    @property
    def worst_class(self) -> str:
        """The class of the worst pair of all."""
        return max(self.classes, key=lambda name: self.classes[name].worst.delta_e)

    @property
    def worst(self) -> WorstPair:
        """The worst pair of all classes."""
        return self.classes[self.worst_class].worst

    @property
    def rgb_product(self) -> ErrorSummary:
        """The RGB renderer's errors over all classes."""
        return ErrorSummary.of(
            np.concatenate([r.pairs.rgb_product.ravel() for r in self.classes.values()])
        )

    def to_dict(self) -> dict[str, Any]:
        """What ``volspec basis --json`` prints."""
        return {
            "name": self.name,
            "method": self.method,
            "size": self.size,
            "trained_on": self.trained_on,
            "measured_on": self.measured_on,
            "fingerprint": self.fingerprint,
            "observer_deg": self.observer_deg,
            "grid_nm": list(self.grid_nm),
            "classes": {name: _class_dict(r) for name, r in self.classes.items()},
            "rgb_product": asdict(self.rgb_product)
            | {name: asdict(r.rgb_product) for name, r in self.classes.items()},
            "worst": _worst_dict(self.worst)
            | {"class": self.worst_class, "adaptation": ADAPTATION},
        }


def error_table(
    basis: SpectralBasis | MaterialBasis,
    classes: Mapping[str, Sequence[Spectrum]] | None = None,
    reflectances: Reflectances | None = None,
    names: Sequence[str] | None = None,
    *,
    measured_on: str = "",
    progress: Callable[[float], None] = lambda share: None,
) -> ErrorTable:
    """Report on a basis class by class.

    Parameters
    ----------
    basis : SpectralBasis or MaterialBasis
    classes : {name: list of Spectrum}, optional
        Default: the library's smooth and spiky lights.
    reflectances, names
        As `volspec.basis.report.report`.
    measured_on : str
        The reflectances in words; default their number.
    progress : callable
        Called with the finished share, 0…1.

    Raises
    ------
    BasisError, SpectrumError
        As `report`.

    Examples
    --------
    >>> from volspec.basis import load_basis
    >>> from volspec.spectra import light, reflectance
    >>> lamps = {"lamps": [light("A"), light("FL2")]}
    >>> table = error_table(load_basis("general-7"), lamps, [reflectance("gold")])
    >>> table.worst.light, sorted(table.to_dict()["classes"])
    ('FL2', ['lamps'])
    """
    if classes is None:
        classes = {name: light_set(name, basis.grid) for name in CLASSES}
    if not classes:
        raise BasisError("report: no lights given; nothing to compare")
    reports: dict[str, BasisReport] = {}
    total = sum(map(len, classes.values()))
    for name, lights in classes.items():
        reports[name] = report(basis, lights, reflectances, names)
        done = sum(len(r.pairs.lights) for r in reports.values())
        progress(done / total)
    grid = basis.grid
    count = len(next(iter(reports.values())).pairs.reflectances)
    return ErrorTable(
        name=basis.name,
        method=basis.method,
        size=basis.size,
        trained_on=basis.trained_on,
        fingerprint=basis.fingerprint,
        observer_deg=basis.observer_deg,
        grid_nm=(grid.start_nm, grid.stop_nm, grid.step_nm),
        measured_on=measured_on or f"{count} reflectances",
        classes=reports,
    )


def _class_dict(report: BasisReport) -> dict[str, Any]:
    products = {
        str(n): asdict(errors.componentwise) | {"rgb_product": asdict(errors.rgb_product)}
        for n, errors in report.products.items()
    }
    return asdict(report.componentwise) | {
        "lights": len(report.pairs.lights),
        "reflectances": len(report.pairs.reflectances),
        "exact": asdict(report.exact),
        "linear_model": asdict(report.linear_model),
        "rgb_product": asdict(report.rgb_product),
        "products": products,
        "worst": _worst_dict(report.worst),
    }


def _worst_dict(worst: WorstPair) -> dict[str, Any]:
    return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(worst).items()}
