"""The transfer function's panel: one module for each kind of function, and what they share."""

from volspec.viewer.ui.panels.transfer.panel import draw

__all__ = ["draw"]
