# What other packages use of this one; lazy_loader and type checkers read it.
from . import neuro as neuro
from .dicom_headers import DICOM_SUFFIXES as DICOM_SUFFIXES, is_dicom as is_dicom
from .omezarr import ZIP_SUFFIXES as ZIP_SUFFIXES
from .pages import PICTURES as PICTURES, is_stack as is_stack
from .query import Query as Query, SCALES as SCALES, bytes_of as bytes_of
from .tensors import fast_array as fast_array, import_zarr as import_zarr
from .vtk_grid import volume_fields as volume_fields
