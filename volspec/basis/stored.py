"""Either kind of basis, from a file or a coefficient image's header.

JSON -> [stored] -> SpectralBasis | MaterialBasis
"""

from __future__ import annotations

import os
from typing import Any

from volspec.basis import storage
from volspec.basis.materials import MaterialBasis
from volspec.basis.model import SpectralBasis

Basis = SpectralBasis | MaterialBasis
"""What a coefficient image's channels mean."""


def basis_from_dict(data: Any) -> Basis:
    """The inverse of either basis' ``to_dict``.

    Raises
    ------
    BasisError
        If it is not a basis, of another version, or a field is missing or wrong.
    """
    if storage.is_of_materials(data):
        return MaterialBasis.from_dict(data)
    return SpectralBasis.from_dict(data)


def load_basis(name_or_path: str | os.PathLike[str]) -> Basis:
    """A shipped basis by name (``"general-7"``), or a file that ``save`` of either kind wrote.

    Raises
    ------
    BasisError
        Names the file and what is wrong with it; an unknown name lists the shipped ones.
    """
    return storage.load(name_or_path, basis_from_dict)
