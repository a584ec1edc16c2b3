# What other packages use of this one; lazy_loader and type checkers read it.
from . import payload as payload
from .build import (
    MAX_VIEWS as MAX_VIEWS,
    PageSpec as PageSpec,
    PageView as PageView,
    ServedCamera as ServedCamera,
    layers_size as layers_size,
    page_html as page_html,
    page_policy as page_policy,
    scene_bars as scene_bars,
    scene_views as scene_views,
    write_page as write_page,
)
from .packing import pack_view as pack_view
