"""Colour Exchange Format CxF3 (ISO 17972-1): XML with a spectrum, or several, per object [1].

    samples -> [cxf] -> files

A spectrum has its first wavelength (StartWL), and refers to a ColorSpecification, whose
WavelengthRange has the increment.

References
----------
[1] ISO 17972-1:2015, "Graphic technology - Colour data exchange format - Part 1: Relationship to
    CxF3 (CxF/X)".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element

import numpy as np

from volspec.errors import SpectrumError, quote
from volspec.spectra.files.samples import QUANTITY, Sample, SampleSet
from volspec.spectra.files.tables import positive_number, read_number, xml_root

_QUANTITIES = {
    "ReflectanceSpectrum": "reflectance",
    "TransmittanceSpectrum": "transmittance",
    "EmissiveSpectrum": "radiance",
}
"""Spectral quantity by the element's name."""
# Parts of a file's and a measurement's description that become notes.
_FILE_NOTES = ("Creator", "CreationDate", "Description")
_MEASUREMENT_NOTES = ("MeasurementType", "Manufacturer", "Model", "SerialNumber", "Backing")
_MAX_NOTE = 200


@dataclass(frozen=True, slots=True)
class _Specification:
    """A ColorSpecification: wavelengths and notes for the spectra that refer to it."""

    start: str | None = None
    increment: str | None = None
    notes: Mapping[str, str] | None = None


def read_cxf(path: str) -> SampleSet:
    """Read every spectrum of a file's objects.

    An object with several spectra, such as those with and without ultraviolet, gives samples named
    ``OBJECT/SPECIFICATION``. Raises SpectrumError if the file cannot be read or has no spectra.
    """
    root = xml_root(path)
    if _tag(root) != "CxF":
        raise SpectrumError(
            f"{path}: its root is <{_tag(root)}>, expected <CxF>; export it as CxF3",
            code="unsupported",
        )
    samples = tuple(_samples(path, root))
    if not samples:
        listed = ", ".join(f"<{tag}>" for tag in _QUANTITIES)
        raise SpectrumError(
            f"{path}: no object has a spectrum ({listed}); export it with spectral values",
            code="missing",
        )
    return SampleSet(path, "object", samples)


def _samples(path: str, root: Element) -> Iterator[Sample]:
    specifications = {
        node.get("Id", ""): _specification(node)
        for node in root.iterfind(".//{*}ColorSpecification")
    }
    notes = _notes(root.find("{*}FileInformation"), _FILE_NOTES)
    for number, node in enumerate(root.iterfind(".//{*}Object"), start=1):
        label = node.get("Id", "")
        name = node.get("Name", "").strip() or label or str(number)
        spectra = [
            (element.get("ColorSpecification", ""), element)
            for element in node.iter()
            if _tag(element) in _QUANTITIES
        ]
        repeated = Counter(reference for reference, _ in spectra)
        for k, (reference, element) in enumerate(spectra, start=1):
            specification = specifications.get(reference, _Specification())
            sample = _sample(path, name, element, specification)
            if len(spectra) > 1:
                part = element.get("Name") or (reference if repeated[reference] == 1 else str(k))
                sample = replace(sample, name=f"{name}/{part}")
            yield replace(sample, id=label, notes={**notes, **sample.notes})


def _sample(path: str, name: str, element: Element, specification: _Specification) -> Sample:
    where = f"{path}: object {name!r}"
    values = []
    for text in (element.text or "").replace(",", " ").split():
        try:
            values.append(read_number(text))
        except ValueError:
            raise SpectrumError(
                f"{where}: {quote(text)} is not a number; write decimal points and blanks",
                code="syntax",
                given=text,
            ) from None
    if len(values) < 2:
        raise SpectrumError(
            f"{where}: {len(values)} values, expected at least 2; measure it again", code="missing"
        )
    start = _positive(where, "StartWL", element.get("StartWL") or specification.start)
    stop, step = element.get("EndWL"), element.get("Increment") or specification.increment
    if step is None and stop is not None:
        increment = (_positive(where, "EndWL", stop) - start) / (len(values) - 1)
    else:
        increment = _positive(where, "Increment", step)
    wavelengths = np.array([start + increment * k for k in range(len(values))])
    notes = {**(specification.notes or {}), QUANTITY: _QUANTITIES[_tag(element)]}
    return Sample(name, wavelengths, np.array(values), notes=notes)


def _positive(where: str, attribute: str, text: str | None) -> float:
    if text is None:
        raise SpectrumError(
            f"{where}: has no {attribute}; give it, or a ColorSpecification with a WavelengthRange",
            code="missing",
            field=attribute,
        )
    return positive_number(where, attribute, text)


def _specification(element: Element) -> _Specification:
    span = element.find(".//{*}WavelengthRange")
    start, increment = (
        (None, None) if span is None else (span.get("StartWL"), span.get("Increment"))
    )
    return _Specification(start, increment, _notes(element, _MEASUREMENT_NOTES))


def _notes(element: Element | None, tags: tuple[str, ...]) -> dict[str, str]:
    notes = {}
    for node in () if element is None else element.iter():
        text = " ".join((node.text or "").split())
        if _tag(node) in tags and 0 < len(text) <= _MAX_NOTE:
            notes[_note_name(_tag(node))] = text
    return notes


def _note_name(tag: str) -> str:
    """Return "creation date" for CreationDate."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in tag).strip()


def _tag(element: Element) -> str:
    return element.tag.rpartition("}")[2]
