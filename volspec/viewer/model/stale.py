"""What a change costs, as a value: the first stage that must run again.

state, state -> [stale] -> "cast" | "relight" | "frame" | None
"""

from __future__ import annotations

from typing import Literal

from volspec.viewer.model.palette.spectra import repainted
from volspec.viewer.model.state import ViewState

Stage = Literal["cast", "relight", "frame"]

# Field by field; a light is not among those that cast.
STAGES: dict[str, Stage] = {
    "document": "cast",
    "view": "cast",
    "transfer": "cast",
    "shift": "cast",
    "shading": "cast",
    "size": "cast",
    "lights": "relight",
    "seen": "relight",
    "other": "relight",
    "divide": "relight",
    "interface": "frame",
    "kept": "frame",
    "fade": "frame",
    "board": "relight",
    "thickness": "cast",
    "thin": "frame",
}


def stale_stage(old: ViewState | None, new: ViewState) -> Stage | None:
    """The first stage whose result two states do not share.

    Parameters
    ----------
    old : ViewState or None
        What is shown; None where nothing is.
    new : ViewState
        What shall be.

    Returns
    -------
    "cast", "relight", "frame" or None
        None where the window can stay as it is.
    """
    if old is None:
        return "cast"
    if old is new:
        return None
    differ = [name for name in STAGES if getattr(old, name) != getattr(new, name)]
    found = {STAGES[name] for name in differ}
    if "transfer" in differ and repainted(old.transfer, new.transfer):
        # Other reflectances of materials that are channels are read when the picture is lit.
        found = {STAGES[name] for name in differ if name != "transfer"} | {"relight"}
    order: tuple[Stage, ...] = ("cast", "relight", "frame")
    return next((stage for stage in order if stage in found), None)


def lit_otherwise(old: ViewState | None, new: ViewState) -> bool:
    """Whether the picture that is shown must be lit anew, be another under way or not."""
    if old is None:
        return True
    lighting = (name for name, stage in STAGES.items() if stage == "relight")
    differs = any(getattr(old, name) != getattr(new, name) for name in lighting)
    return differs or old.transfer.basis is not new.transfer.basis
