"""State of the viewer and pure functions on it."""
