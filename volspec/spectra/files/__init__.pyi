# What other packages use of this one; lazy_loader and type checkers read it.
from .reading import (
    COLUMNS as COLUMNS,
    palette_grid as palette_grid,
    read_columns as read_columns,
    rebase_address as rebase_address,
    rebase_path as rebase_path,
    split_address as split_address,
)
from .spectral_image import (
    spectral_channels as spectral_channels,
    spectral_header as spectral_header,
)
from .tables import (
    TABLE_SUFFIXES as TABLE_SUFFIXES,
    decoded_text as decoded_text,
    fold_name as fold_name,
    read_number as read_number,
)
