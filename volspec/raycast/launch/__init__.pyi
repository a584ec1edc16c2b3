# What other packages use of this one; lazy_loader and type checkers read it.
from . import kernel_arguments as kernel_arguments
from .bricks import (
    BRICK as BRICK,
    brick_codes as brick_codes,
    brick_ranges as brick_ranges,
    visible_by_table as visible_by_table,
)
from .fields import FieldCast as FieldCast, frame_around as frame_around
from .kernel_arguments import check_reach as check_reach, numbered_sources as numbered_sources
from .layer_stream import (
    check_layers as check_layers,
    empty_rows as empty_rows,
    materials_without_opacity as materials_without_opacity,
    refuse_layers as refuse_layers,
    shadow_slots as shadow_slots,
)
from .light_volume import (
    Transmittance as Transmittance,
    Visibility as Visibility,
    FAR as FAR,
    LightVolume as LightVolume,
    VoxelBox as VoxelBox,
    extinction_per_mm as extinction_per_mm,
    light_layers as light_layers,
)
from .masks import MaskLattice as MaskLattice
from .packets import Packet as Packet, TILES as TILES, choose_packet as choose_packet
from .programs import GROUPS as GROUPS, cast_kernel as cast_kernel
from .row_batches import (
    Cancel as Cancel,
    Progress as Progress,
    Receiver as Receiver,
    Result as Result,
    RowBatches as RowBatches,
)
from .sampling import clip_rays as clip_rays, source_at as source_at, world_rays as world_rays
