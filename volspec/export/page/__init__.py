"""Relightable web pages: one file, no network, the desktop's own shaders on WebGL 2.

scene -> cast -> [page] -> PAGE.html
"""

from volspec.export.page.build import BITS, PageSpec, PageView, page_html, write_page
from volspec.export.page.views import MOST_VIEWS, scene_views

__all__ = [
    "BITS",
    "MOST_VIEWS",
    "PageSpec",
    "PageView",
    "page_html",
    "scene_views",
    "write_page",
]
