"""Relightable web pages: one file, no network, the desktop's shaders on WebGL 2.

scene -> cast -> [page] -> PAGE.html
"""

from volspec.export.page.build import (
    BITS,
    MOST_VIEWS,
    PageSpec,
    PageView,
    ServedCamera,
    layers_size,
    page_html,
    page_policy,
    scene_bars,
    scene_views,
    write_page,
)
from volspec.export.page.packing import pack_view

__all__ = [
    "BITS",
    "MOST_VIEWS",
    "PageSpec",
    "PageView",
    "ServedCamera",
    "layers_size",
    "pack_view",
    "page_html",
    "page_policy",
    "scene_bars",
    "scene_views",
    "write_page",
]
