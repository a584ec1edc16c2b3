# What other packages use of this one; lazy_loader and type checkers read it.
from .pyramid import (
    BLOCK as BLOCK,
    Box as Box,
    COARSE_BYTES as COARSE_BYTES,
    Chunk as Chunk,
    Index as Index,
    Level as Level,
    Pyramid as Pyramid,
    boxes_in as boxes_in,
    cast_dtype as cast_dtype,
    common as common,
    halve as halve,
    ranges_of as ranges_of,
    size_text as size_text,
    with_next as with_next,
)
from .sample import (
    BINS as BINS,
    VoxelSample as VoxelSample,
    VoxelSampler as VoxelSampler,
    counted_step as counted_step,
    histogram_of_values as histogram_of_values,
    step_along as step_along,
)
