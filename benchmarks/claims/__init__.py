"""Figures of colour in the documents, computed again: ``python -m benchmarks.claims [NAME ...]``.

Prints the figures of each claim as they are now, next to those of its page; with names, of the
claims whose names begin so. ``--slow`` adds what takes more than three seconds, which `make trust`
checks, and ``--list`` prints the catalogue: each page's figures and the command that prints them.
``tests/test_claims.py`` checks every figure to one unit of its last digit.
"""

from __future__ import annotations

import re

from benchmarks.claims import appearance, spectra
from benchmarks.claims.model import CLAIMS, Claim, Printed, holds, page_text

__all__ = [
    "CLAIMS",
    "PRINTED",
    "Claim",
    "Printed",
    "appearance",
    "catalogue",
    "holds",
    "page_text",
    "spectra",
]

# Figures of other commands: page, words, command, and its test if the command is none.

PRINTED = tuple(
    Printed(page, text, command, test[0] if test else command.split()[3])
    for page, text, command, *test in (
        line.split(" :: ")
        for line in """
adaptation.md :: | 1000 Δu'v' | mean | :: python -m tools.breneman :: tests/appearance/test_breneman.py
adaptation.md :: come out at Y = 290 and 20 (Nayatani) :: python -m pytest tests/appearance/test_adaptation.py -k levels
appearance.md :: $ volspec appearance 40 35 10 90 5 0 :: volspec appearance :: tests/cli/test_docs.py
appearance.md :: is within CIEDE2000 .001 of :: python -m pytest tests/twins/test_relight_models.py -rP -k draws_a_model
bases.md :: <!-- modes --> :: python -m benchmarks.basis --keep :: tests/test_claims.py
bases.md :: <!-- methods --> :: python -m benchmarks.basis --keep :: tests/test_claims.py
bases.md :: <!-- fine --> :: python -m benchmarks.basis --keep :: tests/test_claims.py
bases.md :: <!-- products --> :: python -m benchmarks.basis --keep :: tests/test_claims.py
bases.md :: <!-- others --> :: python -m benchmarks.basis --keep :: tests/test_claims.py
benchmarks.md :: <!-- figures --> :: python -m benchmarks --keep :: tests/test_benchmarks.py
compositing.md :: under every light: CIEDE2000 below .0001. :: python -m pytest tests/export/test_compositing.py -k blender
gallery/layers.md :: The figures are their difference: CIEDE2000 of :: python -m tools.gallery :: tests/test_gallery.py
layers.md :: turns cameras by 2, 5 and 10° to either side :: python -m benchmarks.views :: tests/raycast/test_reproject.py
models.md :: $ volspec appearance 40 35 10 --white A :: volspec appearance :: tests/test_claims.py
models.md :: $ volspec appearance 109.85 100 35.58 :: volspec appearance :: tests/test_claims.py
models.md :: $ volspec design data/palettes/figure-1.toml :: volspec design :: tests/test_claims.py
models.md :: 1e-6 of J or C (`tests/ :: python -m pytest tests/appearance/test_models_defined.py
models.md :: agree with colour-science to 1e-9 of J, C and h :: python -m pytest tests/appearance/test_models_forward.py
models.md :: to 0.03 of J and 2 % of C (ZCAM :: python -m pytest tests/appearance/test_models_papers.py
models.md :: J off by up to 0.3 where :: python -m pytest tests/appearance/test_models_papers.py
page.md :: CIEDE2000 from the desktop's frame :: python -m benchmarks.webpage :: tests/page/test_page.py
reflectance.md :: $ volspec reflectance "#c08040" :: volspec reflectance :: tests/cli/test_reflectance.py
rooms.md :: within 8 % (root mean square :: python -m benchmarks.rooms :: tests/room/test_specimen.py
viewing.md :: 947 cd/m², with 1.7 % above white :: python -m tools.gallery.hdr :: tests/appearance/test_hdr.py
viewing.md :: 203 cd/m² is 0.5807, 1000 is 0.7518 :: python -m pytest tests/appearance/test_hdr.py
viewing.md :: is within CIEDE2000 0.06 of NumPy :: python -m pytest tests/twins/test_relight_display.py
viewing.md :: $ volspec light lamp:tungsten-2850 :: volspec light :: tests/cli/test_docs.py
viewing.md :: $ volspec light LED-B3 LED-B3 :: volspec light :: tests/cli/test_docs.py
viewing.md :: $ volspec light A --pair :: volspec light :: tests/cli/test_docs.py
""".strip().splitlines()  # noqa: E501
    )
)


def catalogue() -> list[Printed]:
    """Return all figures with the words of their pages, what prints them, and what checks them."""
    own = []
    for each in CLAIMS:
        figures = iter(each.printed)
        text = re.sub(r"\{\}", lambda _, figures=figures: next(figures), each.text)
        command = f"python -m benchmarks.claims '{each.name}'"
        own.append(Printed(each.page, text, command, "tests/test_claims.py"))
    return sorted((*own, *PRINTED), key=lambda each: each.page)
