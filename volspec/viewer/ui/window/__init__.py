"""The window itself: input, focus, where panels stand, what was told and traced."""
