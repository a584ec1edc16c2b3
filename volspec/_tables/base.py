"""A table of a TOML file as a pydantic model, and the kinds of values that tables hold.

[base] -> viewing, messages, palette, scene
"""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from volspec.errors import require_name

# TOML has lists where Python has tuples; all else is taken as it is written.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Box = Annotated[tuple[Pair, Pair, Pair], Field(strict=False)]
Name = Annotated[str, AfterValidator(require_name)]


class Table(BaseModel):
    """One table of the file; an unknown key is an error, so that nothing is lost in silence.

    A key's docstring is its description in the file's JSON schema, its first example what
    messages propose where the key is missing.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True
    )
    # The keys that tell a row from the others of its list: what is written first.
    row_keys: ClassVar[tuple[str, ...]] = ()


def value_or_table(value: object) -> str:
    """Which of a single value and a table is meant; ``<`` keeps it out of messages."""
    return "<table>" if isinstance(value, dict | Table) else "<value>"
