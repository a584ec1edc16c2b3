"""Tables of labels: numbers, names and colours, from files next to a volume and from headers.

    table, header -> [label_tables] -> {number: Label} -> labels

Files: 3-D Slicer (``.ctbl``) and FreeSurfer (``LUT.txt``), ITK-SNAP label descriptions, MRIcron
(``.nii.txt``, ``.nii.lut``), BIDS (``_dseg.tsv``), and JSON of numbers and names in either order
(TotalSegmentator, nnU-Net). Headers: ``Segment0_Name`` of Slicer's NRRD, the XML of Connectome
Workbench and TotalSegmentator in NIfTI extensions, ``image-label`` of OME-Zarr.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from volspec._confine import require_inside
from volspec._parse import parse_xml
from volspec.errors import VolumeError
from volspec.volume.labels import Label, Labels

Colour = tuple[float, float, float]
SUFFIXES = (".ctbl", ".txt", ".lut", ".tsv", ".json", ".label")
_MAX_BYTES = 1 << 24
# Number, red, green, blue, opacity, visibility, mesh visibility, "name".
_SNAP = re.compile(
    r'\s*(\d{1,20})\s+(\d{1,9})\s+(\d{1,9})\s+(\d{1,9})\s+[\d.]+\s+[01]\s+[01]\s+"(.*)"\s*'
)
# Number, name (with spaces at most if colours follow), red, green, blue, opacity.
_NAME_COLOUR = re.compile(
    r"\s*(\d{1,20})\s+(.+?)\s+(\d{1,9})\s+(\d{1,9})\s+(\d{1,9})(?:\s+\d+)?\s*"
)
# Number, name without spaces, another number.
_NAME = re.compile(r"\s*(\d{1,20})\s+(\S+)(?:\s+\d+)?\s*")
_HEX = re.compile(r"#[0-9a-fA-F]{6}")


def read_label_table(path: Path) -> dict[int, Label]:
    """Read a table of labels.

    Raises VolumeError if the file is missing, or none of the known tables.
    """
    require_inside(path, VolumeError)
    try:
        if not path.is_file():
            raise VolumeError(f"{path}: no such file; check labels=", code="not-found")
        labels = _table(path.read_bytes()) if path.stat().st_size <= _MAX_BYTES else {}
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror})", code="damaged") from error
    if not labels:
        raise VolumeError(
            f"{path}: not a table of labels; give lines of a number and a name (and 0 to 255 for "
            'red, green, blue), a .ctbl, an ITK-SNAP description, or JSON such as {"1": "liver"}',
            code="syntax",
        )
    return labels


def _table(data: bytes) -> dict[int, Label]:
    """Return the labels of a file; empty if it is no table."""
    if len(data) == 3 * 256:
        return {n: Label("", _colour(*data[n::256])) for n in range(256)}
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if text.lstrip()[:1] == "{":
        return _json_table(text)
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[0] not in "#%"]
    if lines and "\t" in lines[0] and "name" in lines[0].split("\t"):
        return _tsv_table([line.split("\t") for line in lines])
    labels: dict[int, Label] = {}
    for line in lines:
        r = g = b = None
        if match := _SNAP.fullmatch(line):
            number, r, g, b, name = match.groups()
        elif match := _NAME_COLOUR.fullmatch(line):
            number, name, r, g, b = match.groups()
        elif match := _NAME.fullmatch(line):
            number, name = match.groups()
        else:
            return {}
        labels[int(number)] = Label(name.strip('"'), _colour(r, g, b))
    return labels


def _json_table(text: str) -> dict[int, Label]:
    """Return the labels of ``{"1": "liver"}`` or ``{"labels": {"liver": 1}}``."""
    try:
        table = json.loads(text)
        table = table.get("labels", table)
        pairs = [(key, value) for key, value in table.items() if isinstance(value, str | int)]
        named = [(key, name) if isinstance(name, str) else (name, key) for key, name in pairs]
        return {int(number): Label(str(name)) for number, name in named}
    except (ValueError, AttributeError, RecursionError):
        return {}


def _tsv_table(rows: Sequence[Sequence[str]]) -> dict[int, Label]:
    """Return the labels of a table with the columns ``index``, ``name`` and perhaps ``color``."""
    labels = {}
    for row in rows[1:]:
        fields = dict(zip(rows[0], row, strict=False))
        try:
            code = fields.get("color", "")
            colour = _colour(*bytes.fromhex(code[1:])) if _HEX.fullmatch(code) else None
            labels[int(fields["index"])] = Label(fields["name"].strip(), colour)
        except (KeyError, ValueError):
            return {}
    return labels


def _colour(*codes: Any, maximum: float = 255) -> Colour | None:
    """Return display codes from 0 to ``maximum`` as fractions; None unless they are three."""
    try:
        r, g, b = (float(code) / maximum for code in codes)
    except (TypeError, ValueError):
        return None
    return (r, g, b) if 0 <= min(r, g, b) <= max(r, g, b) <= 1 else None


def labels_beside(path: Path) -> dict[Path, dict[int, Label]]:
    """Return the labels of each table next to a volume, those with names first.

    Theirs is the volume's name with another suffix, with or without its own: ``aal.nii.txt`` and
    ``aal.txt`` belong to ``aal.nii.gz``.
    """
    name = path.name.removesuffix(".gz")
    stems = dict.fromkeys((name, Path(name).stem, Path(Path(name).stem).stem))
    tables = [path.with_name(stem + suffix) for suffix in SUFFIXES for stem in stems if stem]
    labels: dict[Path, dict[int, Label]] = {}
    for table in tables:
        with suppress(VolumeError, OSError):
            if table != path and table.is_file():
                labels[table] = read_label_table(table)
    return labels


def merge_labels(first: Labels, then: Labels) -> dict[int, Label]:
    """Return the labels of two tables; the second fills in missing names and colours.

    >>> merge_labels({1: Label("liver")}, {1: Label("", (1, 0, 0)), 2: Label()})[1]
    Label(name='liver', colour=(1, 0, 0))
    """
    merged = {**then, **first}
    for number in first.keys() & then.keys():
        one, other = first[number], then[number]
        merged[number] = Label(one.name or other.name, one.colour or other.colour)
    return merged


def labels_in_nrrd(pairs: Mapping[str, str], layer: int) -> dict[int, Label] | None:
    """Return a layer's segments in Slicer's NRRD from its keys and values; None without any."""
    labels: dict[int, Label] = {}
    for key, number in pairs.items():
        if not (match := re.fullmatch(r"Segment(\d+)_LabelValue", key)):
            continue
        start = f"Segment{match[1]}_"
        colour = _colour(*pairs.get(start + "Color", "").split(), maximum=1)
        in_layer = pairs.get(start + "Layer", "0").strip() == str(layer)
        if in_layer and number.strip().isdecimal():
            labels[int(number)] = Label(pairs.get(start + "Name", "").strip(), colour)
    return labels or None


def labels_in_xml(text: str) -> dict[int, Label] | None:
    """Return the label table in a NIfTI extension; None if there is none.

    >>> labels_in_xml('<X><LabelTable><Label Key="1">spleen</Label></LabelTable></X>')
    {1: Label(name='spleen', colour=None)}
    """
    try:
        root = parse_xml(text.strip("\0 \n"))
    except ValueError:
        return None
    labels = {}
    for element in root.iter("Label"):
        codes = (element.get(name) for name in ("Red", "Green", "Blue"))
        with suppress(ValueError):
            label = Label((element.text or "").strip(), _colour(*codes, maximum=1))
            labels[int(element.get("Key", ""))] = label
    return labels or None


def labels_in_zarr(attributes: Any) -> dict[int, Label]:
    """Return the labels of OME-Zarr's ``image-label``, with the first text among properties."""
    labels: dict[int, Label] = {}
    try:
        for row in attributes.get("colors") or ():
            colour = _colour(*(row.get("rgba") or ())[:3])
            labels[int(row["label-value"])] = Label("", colour)
        for row in attributes.get("properties") or ():
            number = int(row["label-value"])
            texts = [row[key] for key in ("name", "label", "class") if key in row]
            texts += [value for value in row.values() if isinstance(value, str)]
            labels[number] = Label(str((*texts, "")[0]), labels.get(number, Label()).colour)
    except (KeyError, TypeError, ValueError, AttributeError):
        return {}
    return labels
