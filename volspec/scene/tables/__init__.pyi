# What other packages use of this one; lazy_loader and type checkers read it.
from .annotation import (
    ANGLE as ANGLE,
    Annotation as Annotation,
    DISTANCE as DISTANCE,
    LABEL as LABEL,
    MAX_LETTERS as MAX_LETTERS,
    PlacedAnnotation as PlacedAnnotation,
    place_annotation as place_annotation,
)
from .export import (
    ExportSpec as ExportSpec,
    KeyCamera as KeyCamera,
    Keyframe as Keyframe,
    MARKS as MARKS,
    Mark as Mark,
    Play as Play,
    Turntable as Turntable,
)
from .lights import (
    LightSpec as LightSpec,
    NamedLight as NamedLight,
    require_lux as require_lux,
    rows_by_name as rows_by_name,
)
from .specs import (
    BasisSpec as BasisSpec,
    CameraSpec as CameraSpec,
    EMPTY as EMPTY,
    MaterialSpec as MaterialSpec,
    MeshSpec as MeshSpec,
    OutputSpec as OutputSpec,
    ROOM_LIGHT as ROOM_LIGHT,
    SpectrumNumbers as SpectrumNumbers,
)
from .transfer import TransferSpec as TransferSpec
