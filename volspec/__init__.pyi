# The public names and their modules; lazy_loader, type checkers and editors read them.
from ._confine import confined as confined
from .appearance import Display as Display, Viewing as Viewing
from .basis import (
    MaterialBasis as MaterialBasis,
    SpectralBasis as SpectralBasis,
    load_basis as load_basis,
)
from .camera import Camera as Camera
from .errors import (
    CastCancelled as CastCancelled,
    DeviceError as DeviceError,
    InputError as InputError,
    VolspecError as VolspecError,
    VolspecWarning as VolspecWarning,
)
from .export import write_frame as write_frame
from .export.exporter import Exported as Exported, export as export
from .export.notebook import notebook as notebook
from .image import CoefficientImage as CoefficientImage, DepthEffects as DepthEffects
from .mesh.caster import MeshCaster as MeshCaster, cast_meshes as cast_meshes
from .mesh.grating import Grating as Grating
from .mesh.model import Mesh as Mesh
from .mesh.shapes import shape_mesh as shape_mesh
from .mesh.texture import Texture as Texture
from .palette import (
    Cell as Cell,
    Criteria as Criteria,
    Design as Design,
    DesignReport as DesignReport,
    Palette as Palette,
    PaletteSpectrum as PaletteSpectrum,
    design as design,
    fitted_exposure as fitted_exposure,
    load_palette as load_palette,
    save_palette as save_palette,
    suggestions as suggestions,
)
from .pipeline import (
    Raycaster as Raycaster,
    Relighter as Relighter,
    absorption_error as absorption_error,
    raycast as raycast,
    refine as refine,
    relight as relight,
)
from .raycast import (
    Ambient as Ambient,
    ClipPlane as ClipPlane,
    Directional as Directional,
    Headlight as Headlight,
    LightGroup as LightGroup,
    Point as Point,
    RaycastSpec as RaycastSpec,
    Spot as Spot,
)
from .raycast.vtk_interop import from_plotter as from_plotter
from .relight import LightRig as LightRig, RelightSpec as RelightSpec
from .relight.vtk_interop import picture_plane as picture_plane, to_texture as to_texture
from .room import (
    Room as Room,
    RoomLight as RoomLight,
    load_room as load_room,
    solve_room as solve_room,
)
from .scene import Scene as Scene
from .spectra import (
    Fluorescence as Fluorescence,
    SpectralGrid as SpectralGrid,
    SpectralImage as SpectralImage,
    Spectrum as Spectrum,
    light as light,
    light_names as light_names,
    read_spectrum as read_spectrum,
    reflectance as reflectance,
    reflectance_from_colour as reflectance_from_colour,
    reflectance_names as reflectance_names,
    reflectances_from_colours as reflectances_from_colours,
)
from .transfer import (
    FieldFunctions as FieldFunctions,
    Isosurfaces as Isosurfaces,
    LabelFunction as LabelFunction,
    Mask as Mask,
    Region as Region,
    TransferFunction as TransferFunction,
    TransferFunction2D as TransferFunction2D,
)
from .volume import (
    Series as Series,
    Volume as Volume,
    load_series as load_series,
    load_volume as load_volume,
    phantom as phantom,
)
from .wizard import (
    Redesigned as Redesigned,
    hide as hide,
    keep as keep,
    merge as merge,
    reveal as reveal,
)

__version__: str
__all__: list[str]
