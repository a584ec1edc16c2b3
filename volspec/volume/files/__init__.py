"""Readers of volumes: one file a kind, each from a path and its query to a `Volume`."""
