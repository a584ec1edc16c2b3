"""Assert an error by its class, code and field; transcripts hold the English."""

import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import pytest

from volspec.errors import CODES, VolspecError, VolspecWarning

E = TypeVar("E", bound=VolspecError)


@contextmanager
def raises(
    expected: type[E], code: str | None = None, field: str | None = None
) -> Iterator[pytest.ExceptionInfo[E]]:
    """Assert that a volspec error is raised whose message is one line.

    Parameters
    ----------
    expected : type of VolspecError
    code, field : str, optional
        The error's; left out, any.
    """
    assert code is None or code in CODES, f"{code!r} is no code"
    with pytest.raises(expected) as caught:
        yield caught
    error = caught.value
    assert "\n" not in str(error)
    assert code is None or error.code == code, f"code {error.code!r}, expected {code!r}: {error}"
    assert field is None or error.field == field, (
        f"field {error.field!r}, expected {field!r}: {error}"
    )


def refuses(
    make: Callable[[], object], expected: str, kind: type[VolspecError] = VolspecError
) -> None:
    """Assert that a call raises an error of a code and field, given as ``"code field"``."""
    code, _, field = expected.partition(" ")
    with raises(kind, code, field):
        make()


@contextmanager
def warns(*parts: str, file: str | None = None) -> Iterator[None]:
    """Assert one warning, with these numbers and names in it, about a line of ``file``."""
    with pytest.warns(VolspecWarning) as caught:
        yield
    assert len(caught) == 1
    text = str(caught[0].message)
    assert [part for part in parts if part not in text] == [], text
    assert file in (None, caught[0].filename)


def advised_address(text: object) -> str:
    """Return the address with options that a message advises, as a shell would read it."""
    (quoted,) = re.findall(r"'[^']*\?[^']*'", str(text))
    (address,) = shlex.split(quoted)
    return address
