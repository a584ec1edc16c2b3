"""The command line: thin, every command a few calls into the package.

One file a group of commands; importing them adds them to `volspec.cli.shell.app`. What is slow to
import waits inside the commands.
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
]
