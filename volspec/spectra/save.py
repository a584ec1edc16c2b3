"""Spectra to text tables that `read_spectrum` takes.

spectrum -> [save] -> scenes, command line
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from volspec._files import write_whole
from volspec.errors import SpectrumError
from volspec.spectra._paths import path_text
from volspec.spectra.spectrum import Spectrum

# What the reader takes for the name of a note.
_KEY = re.compile(r"[a-z][\w ()/%-]{0,39}")


def write_spectrum(spectrum: Spectrum, path: str | os.PathLike[str]) -> None:
    """Write one spectrum as a table of nm and values, whole or not at all.

    Parameters
    ----------
    spectrum : Spectrum
        Its notes become ``# key: value`` lines, which `read_spectrum` gives back.
    path : path
        Ends in ``.csv``.

    Raises
    ------
    SpectrumError
        If the name does not end in ``.csv``.
    InputError
        If the folder cannot be written to.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from volspec.spectra import read_spectrum
    >>> with TemporaryDirectory() as folder:
    ...     paint = Spectrum([400, 700], [0.2, 0.4], notes={"maker": "me"})
    ...     write_spectrum(paint, f"{folder}/a.csv")
    ...     back = read_spectrum(f"{folder}/a.csv")
    >>> back.values.tolist(), back.notes["maker"]
    ([0.2, 0.4], 'me')
    """
    name = path_text(path)
    if Path(name).suffix.lower() != ".csv":
        raise SpectrumError(f"{name}: spectra are written as text tables; name it .csv")
    lines = [
        f"# {key}: {' '.join(value.split())}"
        for key, value in spectrum.notes.items()
        if _KEY.fullmatch(key) and value.strip()
    ]
    lines.append("nm,value")
    lines += [
        f"{w:.10g},{v:.10g}"
        for w, v in zip(spectrum.wavelengths_nm.tolist(), spectrum.values.tolist(), strict=True)
    ]
    with write_whole(name) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
