"""The transfer function under the mouse: parts, presets, one kind made into another."""
