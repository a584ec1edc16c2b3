"""The panel of the lights."""
