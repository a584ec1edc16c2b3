"""Swap the light on a volume: cast once, relight for ever.

Nothing heavy is loaded here: a name's module is imported when the name is first used. The names
and their modules are those of ``__init__.pyi``, which type checkers and editors read as well.
"""

from __future__ import annotations

import copyreg
import sys
from types import MappingProxyType, ModuleType
from typing import Any

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *_names]


class _Package(ModuleType):
    """``raycast``, ``relight`` and ``export`` are subpackages; as attributes they are functions.

    Importing a subpackage sets it as an attribute of its parent, which would hide the function.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _names and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def _read_only(items: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(items)


# Read-only mappings are attributes of many frozen objects; Python can neither pickle nor copy them.
copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))
