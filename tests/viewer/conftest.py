"""A document without a device, as the pure parts of the viewer see it; a screen for the window."""

from __future__ import annotations

import pytest

from tests.support.viewer import small_document
from tests.support.window import missing
from volspec.viewer.model.document import Document
from volspec.viewer.model.state import ViewState


@pytest.fixture(scope="session")
def document() -> Document:
    return small_document()


@pytest.fixture(scope="session")
def state(document: Document) -> ViewState:
    return ViewState.first(document, (160, 120))


@pytest.fixture(scope="session")
def screen() -> None:
    """Skip, and say why, where no display can be made for a window."""
    if lacking := missing():
        pytest.skip(lacking)
