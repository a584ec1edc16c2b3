"""Report of a design: its measures, with suggestions, as text and for JSON.

design -> measures, advice, text -> [report] -> figure, JSON
"""

from __future__ import annotations

from collections.abc import Sequence

from volspec.appearance.comparison import Difference
from volspec.palette.measures import DesignMeasures
from volspec.palette.optimisation import Design
from volspec.palette.text import plain_text


class DesignReport(DesignMeasures):
    """Figures of a design.

    Parameters
    ----------
    cells : tuple of CellReport
        Every place, row by row.
    metamers : tuple of MetamerReport
    spectra : tuple of SpectrumReport
    exposure : float
    cost : {criterion: float}
        Terms ``colours``, ``smoothness``, ``subspace`` and ``apart`` of the sum that the design
        minimises.
    suggestions : tuple of str
        Changes that would help; see `volspec.suggestions`.
    difference : {"CIEDE2000", "CAM16-UCS"}
        Measure of the errors and of the metamers.
    apart : tuple of ApartReport
    """

    __slots__ = ()

    @classmethod
    def of(
        cls,
        design: Design,
        suggestions: Sequence[str] = (),
        *,
        difference: Difference = "CIEDE2000",
    ) -> DesignReport:
        """Measure a design.

        Parameters
        ----------
        design : Design
        suggestions : sequence of str
            `volspec.suggestions` of the design, to be part of the report.
        difference : {"CIEDE2000", "CAM16-UCS"}
            Measure of the errors and of the metamers; suggestions always use CIEDE2000.
        """
        return cls.measured(design, suggestions, difference)

    def __str__(self) -> str:
        """Return the text that ``volspec design`` prints, without colours."""
        return plain_text(self)
