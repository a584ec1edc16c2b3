"""One browser for all of a page's tests: Debian's Chromium, drawing in software."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.webpage import chromium, missing
from volspec._gpu.sources import asset
from volspec.raycast import CoefficientImage
from volspec.scene import Scene


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium under Playwright, with a user-data folder of its own."""
    if why := missing():
        pytest.skip(why)
    with chromium() as made:
        yield made


@pytest.fixture(scope="session")
def engine_scene() -> Scene:
    return Scene.load(asset("data/scenes/engine.toml"))


@pytest.fixture(scope="session")
def engine_image(engine_scene: Scene) -> CoefficientImage:
    """The engine at 128 x 96: another height than width, so that no mix-up of them stays hidden."""
    return engine_scene.render(size=(128, 96))


@pytest.fixture(scope="session")
def web() -> Path:
    return Path(__file__).resolve().parents[2] / "volspec" / "export" / "page" / "web"
