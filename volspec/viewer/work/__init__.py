"""Threads, files and GL: values in, values out."""
