"""Readers of volume files, a module for each format: Query -> Reading."""
