"""Builders and checks that tests share."""
