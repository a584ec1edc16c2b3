"""The limit of a wait that only ends a hang: no machine, however busy, needs so long."""

from __future__ import annotations

PATIENCE_S = 300.0
