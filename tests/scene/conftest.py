"""Fits of bases that are recorded, not made."""

from pathlib import Path
from typing import Any

import pytest

from volspec.basis import SpectralBasis


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[dict[str, Any]]:
    """Record the arguments of each fit; a shipped basis is returned instead."""
    asked: list[dict[str, Any]] = []

    def fit(lights: Any, reflectances: Any, **settings: Any) -> SpectralBasis:
        rows = [paint.values for paint in reflectances]
        asked.append({"lights": lights, "reflectances": rows, **settings})
        return SpectralBasis.load("general-7")

    monkeypatch.setattr(SpectralBasis, "fit", fit)
    # What was fitted before is read, and what is given here must not be read later.
    monkeypatch.setattr("volspec._cache.cache_folder", lambda: tmp_path / "cache")
    return asked
