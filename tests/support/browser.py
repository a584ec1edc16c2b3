"""Drive the web page in the system's Chromium, under Playwright, with its software GPU."""

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from volspec.appearance.display import spaces
from volspec.appearance.display.spaces import sRGB_CURVE
from volspec.appearance.models.lab import cielab, delta_E_2000

# No network, no first-run pages, a software GPU: reproducible everywhere.
_FLAGS = [
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
    "--disable-sync",
]
# One for each browser that is open, all the same.
_PLAYWRIGHTS: list[Any] = []


def missing() -> str:
    """Return the reason why no browser can be driven; empty if one can."""
    if shutil.which("chromium") is None:
        return "no chromium; run tools/system-packages.sh PYTHON test"
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return "no playwright; pip install volspec[test]"
    return ""


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield the system's Chromium under Playwright, with a user-data folder of its own."""
    from playwright.sync_api import sync_playwright

    # A thread can run one Playwright only, and fixtures of several modules may be open at once.
    playwright = _PLAYWRIGHTS[-1] if _PLAYWRIGHTS else sync_playwright().start()
    _PLAYWRIGHTS.append(playwright)
    try:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=_FLAGS)
        try:
            yield browser
        finally:
            browser.close()
    finally:
        _PLAYWRIGHTS.pop()
        if not _PLAYWRIGHTS:
            playwright.stop()


def saved_picture(page: Any) -> NDArray[np.uint8]:
    """Return the picture that a page's PNG button saves."""
    with page.expect_download() as download:
        page.click("header .download")
    data = Path(download.value.path()).read_bytes()
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def mean_difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Return the mean CIEDE2000 of two frames."""
    return float(differences(one, other).mean())


def differences(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the CIEDE2000 of two frames' pixels."""
    assert one.shape == other.shape
    Lab = [
        cielab(sRGB_CURVE.decode(each / 255.0) @ spaces.XYZ_FROM_sRGB.T, spaces.sRGB_WHITE_XYZ)
        for each in (one, other)
    ]
    return np.asarray(delta_E_2000(*Lab))
