"""Benchmarks: one script per question, both sides measured in the same run."""
