# What other packages use of this one; lazy_loader and type checkers read it.
from . import presets as presets
from .channel_look import channel_functions as channel_functions
from .discrete import Isosurfaces as Isosurfaces, LabelFunction as LabelFunction
from .fields import (
    FieldFunctions as FieldFunctions,
    FieldTables as FieldTables,
    Label as Label,
    Mask as Mask,
    MaskTables as MaskTables,
    OWN as OWN,
)
from .kinds import Table as Table, Tables as Tables, Transfer as Transfer, Transfers as Transfers
from .label_look import (
    LABELS as LABELS,
    label_function as label_function,
    with_labels as with_labels,
)
from .nan_voxels import MaskLabels as MaskLabels, bake_for_volume as bake_for_volume
from .mixtures import (
    Mix as Mix,
    Point as Point,
    mix_weights as mix_weights,
    used_materials as used_materials,
    weight_matrix as weight_matrix,
)
from .model import TransferFunction as TransferFunction
from .opacities import check_opacities as check_opacities, scale_opacities as scale_opacities
from .regions import Region as Region, TransferFunction2D as TransferFunction2D
from .table import (
    MAX_CHANNELS as MAX_CHANNELS,
    MAX_LABEL as MAX_LABEL,
    MAX_MATERIALS as MAX_MATERIALS,
    MAX_SURFACES as MAX_SURFACES,
    NEAREST_POSITIONS as NEAREST_POSITIONS,
    SurfaceTable as SurfaceTable,
    TransferTable as TransferTable,
    integral_rows as integral_rows,
    segment_means as segment_means,
)
from .vtk_interop import transfer_from_vtk as transfer_from_vtk
