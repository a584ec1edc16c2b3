"""Names that the library's spectra have, as commands list them: all, or those that hold a text."""

from __future__ import annotations

from collections.abc import Sequence

from volspec.cli.shell import print_json, say
from volspec.errors import InputError, nearest


def show_names(names: Sequence[str], search: str, what: str, as_json: bool) -> None:
    """Print the names that contain a text, in any case, a line each.

    Parameters
    ----------
    names : sequence of str
    search : str
        Empty for all of them.
    what : str
        Of what they are, for the message.
    as_json : bool
        Print a list of ``{"name": …}``.

    Raises
    ------
    InputError
        If no name contains it.
    """
    found = [name for name in names if search.casefold() in name.casefold()]
    if not found:
        raise InputError(
            f"--list {search!r}: no {what}'s name contains it; {nearest(search, names)}"
            "leave it out to see all",
            code="unknown",
        )
    if as_json:
        print_json([{"name": name} for name in found])
        return
    for name in found:
        say(name)
