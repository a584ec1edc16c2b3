"""Surface, projection and quality of a cast: edits and commands.

panel, commands -> [quality] -> RaycastSpec -> cast
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

from volspec.basis import MaterialBasis
from volspec.errors import InputError
from volspec.image import MAX_MATERIALS
from volspec.raycast import MAX_STEPS, MODES, Quality, RaycastSpec, diagonal_mm
from volspec.transfer import Isosurfaces, TransferFunction, TransferFunction2D, presets
from volspec.viewer.model.edit import (
    Command,
    Edited,
    bind,
    edit,
    refusable,
    switch,
    with_field,
    with_values,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

# Step, in smallest spacings.
STEPS = (0.05, 4.0)
QUALITIES: tuple[Quality, ...] = get_args(Quality)


def step_voxels(state: ViewState) -> float:
    """Return the step in smallest spacings; half of one if quality chooses it."""
    volume = state.document.volume
    return state.shading.step_of(volume) / min(volume.spacing_mm)


def can_project(state: ViewState) -> bool:
    """Return True if the transfer function allows projections and pre-integration."""
    transfer = state.transfer
    return (
        isinstance(transfer, TransferFunction)
        and transfer.gradient_opacity is None
        and not transfer.filters
        and not state.fields
    )


def _can_lengthen_steps(state: ViewState) -> bool:
    """Return True if the transfer function allows adaptive steps."""
    transfer = state.transfer
    if state.fields:
        return False
    if isinstance(transfer, TransferFunction):
        return not transfer.filters
    return not isinstance(transfer, Isosurfaces)


LAYERS = 8
"""Layers of a cast whose settings name none."""


def can_layer(state: ViewState) -> bool:
    """Return True if a cast of the state can have layers of opacity."""
    document, spec, transfer = state.document, state.shading, state.transfer
    if document.image is not None:
        return document.image.opacity_layers is not None
    projects = spec.mode != "composite" or spec.preintegrated
    return (
        isinstance(transfer, TransferFunction | TransferFunction2D)
        and isinstance(transfer.basis, MaterialBasis)
        and 0 < len(transfer.basis.materials) <= MAX_MATERIALS
        and not (isinstance(transfer, TransferFunction) and transfer.filters)
        and not (state.fields or state.room)
        and all(row.opacity == 1.0 and spec.layers != 1 for row in state.meshes if row.shown)
        and document.volume.pyramid is None
        and not (projects and can_project(state))
    )


def opacity_scales(state: ViewState) -> dict[str, float]:
    """Return the scales of opacities other than 1, of materials that are channels."""
    basis, scales = state.transfer.basis, state.shading.opacities
    materials = basis.materials if isinstance(basis, MaterialBasis) else {}
    return {name: scales[name] for name in materials if scales.get(name, 1.0) != 1.0}


def cast_spec(state: ViewState) -> RaycastSpec:
    """Return the settings of a state's cast, without those that the picture cannot have.

    The state keeps them for the next transfer function.
    """
    spec = state.shading
    if spec.opacities:
        spec = replace(spec, opacities=opacity_scales(state))
    if spec.layers and not can_layer(state):
        spec = replace(spec, layers=0)
    if not can_project(state):
        spec = replace(spec, mode="composite", preintegrated=False)
    return spec if _can_lengthen_steps(state) else replace(spec, adaptive=0.0)


@edit
def set_cast(state: ViewState, name: str, value: object) -> ViewState:
    """Set a field of the cast's settings that suits every transfer function."""
    return with_values(state, shading=with_field(state.shading, name, value))


@refusable
def set_projection(state: ViewState, mode: str) -> ViewState:
    """Show opacity and colour, or the greatest or the mean value along each ray."""
    match = next((name for name in MODES if name == mode), None)
    if match is None or match == state.shading.mode:
        return state
    if match != "composite":
        require_curve(state, f"Projection: {match}")
    # Pre-integration and layers have no meaning with the others; they come back with composite.
    blends = match == "composite"
    opened = state.document.shading
    smooth = blends and opened.preintegrated and can_project(state)
    return _change(state, mode=match, preintegrated=smooth, layers=opened.layers if blends else 0)


def project(state: ViewState, mode: str) -> Edited:
    """Set the projection; hint at the grey ramp, as a curve that steps shows flat areas."""
    edited = set_projection(state, mode)
    if edited.state is state or not wants_greys(edited.state):
        return edited
    return edited._replace(hint="For greys by value: Transfer › Preset: Grey ramp")


def wants_greys(state: ViewState) -> bool:
    """Return True if values are projected without the grey ramp."""
    if state.shading.mode == "composite":
        return False
    document, grey = state.document, presets.BY_NAME["grey"]
    return not presets.is_preset(state.transfer, grey, document.volume, document.data[""].histogram)


@refusable
def toggle_preintegration(state: ViewState) -> ViewState:
    """Integrate the transfer function within each step, or read it once."""
    on = not state.shading.preintegrated
    if on:
        require_curve(state, "Pre-integration")
        return _change(state, preintegrated=True, mode="composite", layers=0)
    return _change(state, preintegrated=False, layers=state.document.shading.layers)


def require_curve(state: ViewState, feature: str) -> None:
    """Raise InputError unless the transfer function allows projections and pre-integration."""
    if state.fields:
        raise InputError(
            f"{feature} does not work with several fields or a mask",
            "open the volume alone for it",
            code="conflict",
        )
    if not can_project(state):
        raise InputError(
            f"{feature} needs a curve, without opacity by gradient and without filters",
            "choose Kind: Curve in the Transfer panel",
            code="conflict",
        )


@edit
def set_step(state: ViewState, voxels: float) -> ViewState:
    """Set the step in smallest spacings."""
    volume = state.document.volume
    spacing = min(volume.spacing_mm)
    min_mm = diagonal_mm(volume) / MAX_STEPS
    step = clamp(clamp(voxels, *STEPS) * spacing, 1.01 * min_mm, diagonal_mm(volume))
    return _change(state, step_mm=step)


def _toggle_jitter(state: ViewState) -> ViewState:
    return set_cast(state, "jitter", 0.0 if state.shading.jitter > 0 else 1.0)


@edit
def set_quality(state: ViewState, name: str) -> ViewState:
    """Let quality choose the step and the opacity at which rays end: fast, balanced or exact."""
    if name not in QUALITIES:
        return state
    return _change(state, quality=name, step_mm=None, alpha_stop=None, adaptive=0.0)


def quality_name(state: ViewState) -> str:
    """Return the quality that chooses the step; empty if the step is given."""
    spec = state.shading
    return str(spec.quality) if spec.step_mm is None else ""


def _change(state: ViewState, **changes: Any) -> ViewState:
    return replace(state, shading=replace(state.shading, **changes))


def _projection(mode: str, title: str, words: str) -> Command:
    return Command(
        f"projection-{mode}",
        "Render",
        f"Projection: {title}",
        (),
        bind(project, mode),
        lambda state: state.shading.mode == mode,
        words,
    )


def _quality(name: str, words: str) -> Command:
    return Command(
        f"quality-{name}",
        "Render",
        f"Quality: {name}",
        (),
        bind(set_quality, name),
        lambda state: quality_name(state) == name,
        words,
    )


COMMANDS = (
    _projection("composite", "composite", "volume rendering opacity alpha blend"),
    _projection("maximum", "maximum (MIP)", "intensity"),
    _projection("average", "average", "mean x-ray radiograph intensity"),
    _quality("fast", "draft speed performance coarse step sampling"),
    _quality("balanced", "standard normal default step sampling"),
    _quality("exact", "high best fine slow step sampling"),
    switch(
        *("shading.physical_light", "physical-light", "Render", "Physical shadows"),
        words="occlusion light true exact brute force voxels quality",
    ),
    Command(
        "jitter",
        "Render",
        "Jitter against rings",
        (),
        _toggle_jitter,
        lambda state: state.shading.jitter > 0,
        "noise dither wood grain banding artefacts quality",
    ),
    Command(
        "preintegration",
        "Render",
        "Pre-integration",
        (),
        toggle_preintegration,
        lambda state: state.shading.preintegrated,
        "preintegrated rings banding quality",
    ),
)
