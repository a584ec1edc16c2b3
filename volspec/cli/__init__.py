"""The command line: thin, every command a few calls into the package.

One file a group of commands; importing them adds them to `volspec.cli.shell.app`. What is slow to
import waits inside the commands.
"""

from volspec.cli import (
    appearance,
    basis,
    cast,
    compositing,
    demo,
    design,
    export,
    inspect,
    light,
    page,
    reflectance,
    relight,
    scene,
    view,
    wizard,
)
from volspec.cli.shell import app, main

__all__ = [
    "app",
    "appearance",
    "basis",
    "cast",
    "compositing",
    "demo",
    "design",
    "export",
    "inspect",
    "light",
    "main",
    "page",
    "reflectance",
    "relight",
    "scene",
    "view",
    "wizard",
]
