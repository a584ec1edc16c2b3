"""The command line: thin, every command a few calls into the package.

One file per group of commands; importing a file adds its commands to `volspec.cli.shell.app`. Slow
imports are inside the commands.
"""

from volspec.cli import (
    appearance,
    basis,
    export,
    inspect,
    light,
    palette,
    reflectance,
    relight,
    render,
    room,
)
from volspec.cli.shell import app, main

__all__ = [
    "app",
    "appearance",
    "basis",
    "export",
    "inspect",
    "light",
    "main",
    "palette",
    "reflectance",
    "relight",
    "render",
    "room",
]
