"""The panel of the palette."""
