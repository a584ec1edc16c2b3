"""``make bench``: every benchmark, ratios on screen and in ``build/bench.json``."""

from __future__ import annotations

from benchmarks import cast, light
from benchmarks.measure import save

if __name__ == "__main__":
    save([row for module in (cast, light) for row in module.rows()])
