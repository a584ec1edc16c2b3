"""The fields of a volume as they are shown: transfer function, weight and visibility of each.

scene -> [field_looks] -> state
"""

from __future__ import annotations

from dataclasses import dataclass

from volspec.transfer import FieldFunctions, Mask, Transfer, Transfers


@dataclass(frozen=True, slots=True)
class FieldLook:
    """A field's transfer function, factor of its extinction, and whether it is shown.

    The name is ``""`` for the volume's own field. Materials and basis are those of the state, also
    for the functions of the mask, if the field has one; there is no editor of masks.
    """

    name: str
    transfer: Transfer
    weight: float = 1.0
    shown: bool = True
    mask: Mask | None = None


def field_looks(transfer: Transfers) -> tuple[Transfer, tuple[FieldLook, ...]]:
    """Return the first field's transfer function, and all fields; none if there is only one."""
    if not isinstance(transfer, FieldFunctions):
        return transfer, ()
    looks = []
    for name, function in transfer.functions.items():
        weight = transfer.weights.get(name, 1.0)
        mask = transfer.masks.get(name)
        looks.append(FieldLook(name, function, weight or 1.0, weight > 0, mask))
    return looks[0].transfer, tuple(looks)
