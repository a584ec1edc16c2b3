# What other packages use of this one; lazy_loader and type checkers read it.
from .camera import (
    Camera as Camera,
    OF_PATIENT as OF_PATIENT,
    Orbit as Orbit,
    RayField as RayField,
    SIDES as SIDES,
    level_axes as level_axes,
    radius_mm as radius_mm,
    slice_view as slice_view,
)
from .projection import (
    AXES as AXES,
    NEAR as NEAR,
    PATIENT as PATIENT,
    Place as Place,
    Projection as Projection,
    cube_faces as cube_faces,
    cube_label as cube_label,
    face_normal as face_normal,
    is_patient as is_patient,
    length_mm as length_mm,
    length_text as length_text,
    place_text as place_text,
    place_unit as place_unit,
    scale_text as scale_text,
    side_deg as side_deg,
)
