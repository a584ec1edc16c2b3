"""Statements of a file about its values and axes, and what had to be assumed.

    reader -> [Metadata] -> Reading -> Volume.metadata -> presets, sides, units, `info`

Nothing here is derived from voxels: a file that does not say that it holds Hounsfield units does
not, whatever its range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

NO_SPACING = "voxels 1 mm apart"
"""Assumption about a file that states no distances."""
NO_UNIT = "lengths in mm"
"""Assumption about a file that states distances without their unit."""
ONE_SLICE, NO_DEPTH = "one slice, repeated behind itself", "as deep as a pixel"
"""Assumptions about a file of one slice, and about one that states no thickness of it."""
HU = "HU"
"""Unit of a CT's rescaled values."""


@dataclass(frozen=True, slots=True)
class Metadata:
    """Statements of a file; what it does not state is empty or False.

    Attributes
    ----------
    modality : str
        DICOM's code (0008,0060), such as ``CT``.
    unit : str
        Unit of the values, such as ``HU``.
    is_patient : bool
        True if the world's axes lead to a patient's left, back and head (LPS).
    assumed : tuple of str
        What was taken because the file does not say it, such as `NO_SPACING`.
    is_log : bool
        True if voxels hold the decimal logarithms of the file's values, and so do transfer
        functions: 2 is 100. Between voxels these are interpolated.
    """

    modality: str = ""
    unit: str = ""
    is_patient: bool = False
    assumed: tuple[str, ...] = ()
    is_log: bool = False

    @property
    def in_hounsfield(self) -> bool:
        """True if the values are stated to be Hounsfield units."""
        return self.unit == HU and not self.is_log

    @property
    def assumed_lengths(self) -> tuple[str, ...]:
        """Assumptions on lengths."""
        return tuple(text for text in self.assumed if " mm" in text or " µm" in text)

    def given(self, unit: str | None, has_spacing: bool) -> Metadata:
        """Return this with what an address states: a unit of the values, and a spacing in mm.

        >>> Metadata(assumed=(NO_SPACING,)).given("HU", True)
        Metadata(modality='', unit='HU', is_patient=False, assumed=(), is_log=False)
        """
        lengths = (*self.assumed_lengths, NO_DEPTH) if has_spacing else ()
        assumed = tuple(text for text in self.assumed if text not in lengths)
        return replace(self, unit=self.unit if unit is None else unit, assumed=assumed)

    def __str__(self) -> str:
        """Return a line for people.

        >>> print(Metadata("CT", "HU", assumed=(NO_UNIT,)))
        CT, values in HU; assumed: lengths in mm
        """
        parts = [self.modality, f"values in {self.unit}" if self.unit else ""]
        parts += ["logarithms are shown"] if self.is_log else []
        assumed = f"assumed: {', '.join(self.assumed)}" if self.assumed else ""
        return "; ".join(filter(None, (", ".join(filter(None, parts)), assumed)))
