"""Summary of a volume's size, geometry and histogram, as `volspec info` prints it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from volspec.volume.channels import unique_titles
from volspec.volume.metadata import Metadata
from volspec.volume.model import Volume

if TYPE_CHECKING:
    from rich.table import Table

_BINS = 16
_BAR = 40
# Lengths below this many millimetres are given in micrometres.
_SHORT_MM = 0.1
# Letters of the negative and positive axes in ITK's LPS frame.
_LETTERS = ("RL", "AP", "IS")
# Most labels that the table lists.
_MAX_LISTED = 12


@dataclass(frozen=True, slots=True)
class VolumeSummary:
    """Size, geometry and distribution of a volume."""

    name: str
    shape: tuple[int, int, int]
    dtype: str
    spacing_mm: tuple[float, float, float]
    extent_mm: tuple[float, float, float]
    origin_mm: tuple[float, float, float]
    orientation: list[list[float]]  # columns: directions of the x, y and z axes in the world
    # To where the axes lead in the patient, such as LPS: left, posterior, superior; empty if the
    # file does not state a patient's axes.
    directions: str
    metadata: Metadata
    range: tuple[float, float]
    mean: float
    histogram: list[tuple[float, float, int]]  # from, to (included by integers), count
    missing: int  # voxels that are NaN or infinite
    labels: dict[int, str]  # names of a segmentation's labels by number; empty for other volumes
    channels: dict[str, tuple[float, float]]  # ranges by name, if there are several; or empty
    steps: int = 1  # of time; ranges are of all, the rest is of the one that is summarised
    # Of a volume larger than memory, the size of the level of which mean and histogram are.
    level: tuple[int, int, int] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Convert to JSON types."""
        return asdict(self)

    def table(self) -> Table:
        """Make a table for a terminal; bars grow with the logarithm of the count."""
        from rich.table import Table

        table = Table(title=self.name, show_header=False)
        table.add_row("size", " × ".join(str(n) for n in self.shape) + f", {self.dtype}")
        table.add_row("spacing", _lengths(self.spacing_mm))
        table.add_row("extent", _lengths(self.extent_mm))
        table.add_row("origin", ", ".join(f"{s:g}" for s in self.origin_mm) + " mm")
        columns = np.array(self.orientation).T
        axes = ["(" + ", ".join(f"{v:g}" for v in column) + ")" for column in columns]
        letters = f"{self.directions}: " if self.directions else ""
        table.add_row("axes x y z", letters + " ".join(axes))
        if text := str(self.metadata):
            table.add_row("stated", text)
        if self.steps > 1:
            table.add_row("time steps", f"{self.steps}; below, the first")
        if self.channels:
            ranges = (f"{name} {range_text(*ends)}" for name, ends in self.channels.items())
            table.add_row("channels", "; ".join(ranges) + "; below, the first")
        (low, high), mean = self.range, value_format(*self.range, 4) % self.mean
        value = "%.0f" if self.labels else value_format(low, high, 6)
        table.add_row("range", f"{value % low} … {value % high}, mean {mean}")
        if self.missing:
            why = "have no logarithm" if self.metadata.is_log else "are NaN or infinite"
            table.add_row("missing", f"{self.missing:,} voxels {why}: transparent")
        if self.labels:
            table.add_row("labels", self._label_text())
        max_count = max(count for _, _, count in self.histogram)
        for low, high, count in self.histogram:
            length = round(_BAR * np.log1p(count) / np.log1p(max_count))
            table.add_row(f"{value % low} … {value % high}", "█" * length + f" {count:,}")
        table.caption = "histogram bars: logarithmic"
        if self.level is not None:
            sides = " × ".join(map(str, self.level))
            table.caption += f"\nmean and histogram: of {sides} voxels"
        return table

    def _label_text(self) -> str:
        """Return the number of labels, and the names of the first, or all numbers if few."""
        named = [f"{number} {name}" for number, name in self.labels.items() if name]
        listed = named or [str(number) for number in self.labels]
        more = ", …" if len(listed) > _MAX_LISTED else ""
        return f"{len(self.labels)}: {', '.join(listed[:_MAX_LISTED])}{more}"


def value_format(low: float, high: float, digits: int = 5) -> str:
    """Return a printf format of values in a range, with digits of the range however far from 0.

    >>> [value_format(*ends) % ends[1] for ends in ((0, 1.5), (1e6, 1e6 + 1.25), (0, 1e-40))]
    ['1.5', '1000001.25', '1e-40']
    """
    far = max(abs(low), abs(high)) / ((high - low) or math.inf)
    return f"%.{digits + min(round(math.log10(max(far, 1.0))), 10)}g"


def value_form(volume: Volume, digits: int = 5) -> str:
    """Return a printf format of a volume's voxels; of logarithms, as powers."""
    power = "10^" if volume.metadata.is_log else ""
    return power + value_format(*volume.typical_range, digits)


def value_text(volume: Volume, value: float, digits: int = 5) -> str:
    """Return a voxel's value as text, as it was given."""
    if volume.numbers:
        return str(volume.stated(value))
    low, high = volume.stated(volume.range).tolist()
    return value_format(low, high, digits) % volume.stated(value)


def range_text(low: float, high: float) -> str:
    """Return the ends of a range as text."""
    value = value_format(low, high, 6)
    return f"{value % low} … {value % high}"


def _lengths(lengths_mm: tuple[float, float, float]) -> str:
    """Return lengths as text, in micrometres if all are short.

    >>> _lengths((0.0005, 0.0005, 0.002)), _lengths((0.5, 0.5, 2.0))
    ('0.5 × 0.5 × 2 µm', '0.5 × 0.5 × 2 mm')
    """
    scale, unit = (1e3, "µm") if max(lengths_mm) < _SHORT_MM else (1.0, "mm")
    return " × ".join(f"{length * scale:g}" for length in lengths_mm) + f" {unit}"


def _directions(volume: Volume) -> str:
    """Return a letter for each axis of the voxels; empty if they are not a patient's."""
    if not volume.metadata.is_patient:
        return ""
    columns = volume.world_from_index[:3, :3].T / np.asarray(volume.spacing_mm)
    return "".join(
        _LETTERS[int(np.abs(column).argmax())][int(column[np.abs(column).argmax()] > 0)]
        for column in columns
    )


def _channels(volume: Volume) -> dict[str, tuple[float, float]]:
    if not volume.fields:
        return {}
    volumes = volume, *volume.fields
    names = unique_titles([channel.title for channel in volumes])
    return {name: channel.range for name, channel in zip(names, volumes, strict=True)}


def summarise(volume: Volume, steps: int = 1) -> VolumeSummary:
    """Measure size, geometry and histogram of a volume, or of one of several time steps."""
    low, high = volume.range
    present = volume.values
    if volume.missing is not None:
        present = present[present != volume.missing]
    edges = np.linspace(low, high, _BINS + 1)
    if volume.values.dtype.kind in "ui":  # whole numbers fall into bins of whole numbers
        edges = np.unique(np.linspace(low, high + 1, _BINS + 1).round())
    counts, edges = np.histogram(present, bins=edges)
    ends = edges[1:] - 1 if volume.values.dtype.kind in "ui" else edges[1:]
    bins = zip(volume.stated(edges[:-1]), volume.stated(ends), counts, strict=True)
    finest = volume.finest
    spacing = finest.spacing_mm
    x, y, z = ((n - 1) * s for n, s in zip(finest.shape_xyz, spacing, strict=True))
    origin = finest.world_from_index[:3, 3].tolist()
    return VolumeSummary(
        name=volume.name,
        shape=finest.shape_xyz,
        dtype=volume.values.dtype.name,
        spacing_mm=spacing,
        extent_mm=(x, y, z),
        # A sum with 0 has no negative zero.
        origin_mm=(origin[0] + 0.0, origin[1] + 0.0, origin[2] + 0.0),
        orientation=(finest.world_from_index[:3, :3] / np.asarray(spacing) + 0.0).tolist(),
        directions=_directions(finest),
        metadata=volume.metadata,
        range=(float(volume.stated(low)), float(volume.stated(high))),
        mean=float(np.mean(volume.stated(present), dtype=np.float64)),
        missing=volume.values.size - present.size,
        histogram=[(float(a), float(b), int(n)) for a, b, n in bins],
        labels={number: label.name for number, label in volume.labels.items()},
        channels=_channels(volume),
        steps=steps,
        level=None if volume.pyramid is None else volume.shape_xyz,
    )
