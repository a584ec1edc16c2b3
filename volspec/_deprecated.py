"""Deprecated names: usable for one version, with a `DeprecationWarning` at each use.

    [_deprecated] -> volspec, its packages

A module that renamed something public ends in

    __getattr__ = renamed(__name__, {"passage_of": "view_transform"})

and a function that renamed a keyword accepts both names with ``@renamed_keyword``.
"""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def renamed(
    module: str, names: Mapping[str, str], otherwise: Callable[[str], Any] | None = None
) -> Callable[[str], Any]:
    """Make a module's ``__getattr__`` that resolves old names.

    Parameters
    ----------
    module : str
        ``__name__`` of the module.
    names : {old: new}
        A new name is in the module, or ``"package.module:name"`` in another module.
    otherwise : function of a name, optional
        The module's own ``__getattr__``, for all other names.

    Examples
    --------
    >>> import warnings
    >>> old_names = renamed("math", {"hypotenuse": "hypot", "root": "cmath:sqrt"})
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     old_names("hypotenuse")(3, 4), old_names("root")(-1)
    (5.0, 1j)
    >>> str(caught[0].message)
    'math.hypotenuse is now hypot; the next version removes the old name'
    """

    def __getattr__(name: str) -> Any:
        if name not in names and otherwise is not None:
            return otherwise(name)
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, _, new = names[name].rpartition(":")
        _warn(f"{module}.{name} is now {f'{home}.{new}' if home else new}")
        return getattr(import_module(home) if home else sys.modules[module], new)

    return __getattr__


def renamed_attribute(new: str) -> Any:
    """Make a property that reads an attribute under its old name.

    Examples
    --------
    >>> class Light:
    ...     weights = (1.0,)
    ...     shares = renamed_attribute("weights")
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")
    ...     Light().shares
    (1.0,)
    """

    class Renamed:
        what = new

        def __set_name__(self, owner: type, name: str) -> None:
            self.what = f"{owner.__name__}.{name}"

        def __get__(self, instance: object, owner: type) -> Any:
            _warn(f"{self.what} is now {new}")
            return getattr(owner if instance is None else instance, new)

    return Renamed()


def renamed_keyword(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a decorator for functions that also accept keywords by their old names.

    Parameters
    ----------
    **names
        ``old="new"``.

    Examples
    --------
    >>> @renamed_keyword(seen="spec")
    ... def page(spec=None):
    ...     return spec
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")
    ...     page(seen=1)
    1
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
            for old in names.keys() & kwargs.keys():
                new = names[old]
                if new in kwargs:
                    raise TypeError(f"{function.__qualname__}() got both {old!r} and {new!r}")
                _warn(f"{function.__qualname__}({old}=) is now {new}=")
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return wrapper

    return decorate


def _warn(what: str) -> None:
    message = f"{what}; the next version removes the old name"
    warnings.warn(message, DeprecationWarning, stacklevel=3)
