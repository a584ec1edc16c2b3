"""Read volumes from files and folders, with spacing and orientation.

    file or folder -> [load] -> the reader of its kind (files/) -> Volume

World coordinates are millimetres, in ITK's patient frame (LPS) where the format states one. The
libraries, and the reasons for them: docs/decisions/0001.
"""

from __future__ import annotations

import os
import shlex
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from volspec._confine import require_links_inside
from volspec._files import nearest_file
from volspec.errors import VolspecWarning, VolumeError, quote
from volspec.volume import formats
from volspec.volume.bundled import is_bundled, locate_volume
from volspec.volume.channels import ALL, Channel, unique_titles
from volspec.volume.checks import logarithms
from volspec.volume.files.dicom import series_folders
from volspec.volume.files.dicom_headers import dicom_files
from volspec.volume.files.hdf5 import require_parts_inside
from volspec.volume.files.label_tables import labels_beside, merge_labels, read_label_table
from volspec.volume.files.lattice import with_depth
from volspec.volume.files.omezarr import is_zarr
from volspec.volume.files.presence import GZIP, require_contents, require_slices
from volspec.volume.files.query import Choice, ChoicesListed, Query, Reading, Stored
from volspec.volume.files.slices import pictures_in
from volspec.volume.labels import NAMED, Labels, find_labels, renumber_labels, why_no_labels
from volspec.volume.levels.pyramid import Level, Stack
from volspec.volume.metadata import Metadata
from volspec.volume.model import Volume
from volspec.volume.out_of_memory import level_of, read_coarsest, stored_stack
from volspec.volume.reader_process import choices_in_child, read_in_child

# What to do with files of other formats, by their suffixes: with the file's path, and that of the
# file to make, as Python writes them (!r) or quoted for a shell.
_ADVICE: dict[tuple[str, ...], str] = {
    (".stl", ".ply", ".obj", ".vtp", ".glb", ".gltf"): (
        "is a mesh, not a volume; see it by volspec view {shell}, or voxelise it in Python: "
        "pyvista.read({path!r}).voxelize_binary_mask().save({vti!r})"
    ),
    (".vtu", ".vts"): (
        "is a grid of cells, not of voxels; resample it in Python: pyvista.create_grid(g := "
        "pyvista.read({path!r}), dimensions=(128, 128, 128)).sample(g).save({vti!r})"
    ),
    (".nc", ".mat"): (
        "holds named arrays; open it in Python, such as with xarray or SciPy, and pass one to "
        "vs.Volume(array), or save it by numpy.save"
    ),
    (".lsm", ".vsi", ".zvi", ".ics", ".dv"): (
        "is a microscope's format; save it as OME-TIFF in Fiji (File, Import, Bio-Formats), or as "
        "OME-Zarr with bioformats2raw"
    ),
    (".gif", ".webp"): "is a picture of a kind that is not read; save it as PNG or TIFF",
    (".zip", ".rar", ".7z", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".zst"): (
        "is packed; unpack it first, then give the file or the folder in it"
    ),
}
# Bytes up to which a volume is converted as a whole.
_CONVERTED_BYTES = 2**28
# Most numbers of a table of labels that an error lists.
_MAX_NUMBERS = 4
# Endings of files that a missing volume is never a misspelling of.
_NEVER_VOLUMES = (".toml", ".exr", ".html", ".py")
_RAW = "'FILE.raw?shape=256x256x110&dtype=uint8'"
_KNOWN = f"{formats.KNOWN}, a folder of slices (DICOM, TIFF, PNG, BMP, JPEG), or {_RAW}"


def load_volume(path: str | os.PathLike[str]) -> Volume:
    """Read a volume from a file or a folder; what a file begins with decides, then its ending.

    Options follow a question mark. ``spacing=X,Y,Z`` in millimetres overrides the file's and treats
    slices as even; ``channel=N`` and ``time=N`` count from 0. Without ``channel=``, all channels up
    to eight are read: the first, and the others as its `Volume.fields`. ``labels=FILE`` names a
    table of labels, relative to the volume's folder, and so makes the values labels; without it,
    tables next to the volume with its name are read, and labels are recognised. ``scale=log`` shows
    the decimal logarithms of values over decades: points of a transfer function are of these.

    Parameters
    ----------
    path : str or path
        One of

        - ``.nrrd .nhdr .mhd .mha``, ``.nii .nii.gz`` (NIfTI-1 and -2), ``.hdr .img`` (pairs,
          Analyze), ``.mgh .mgz``, AFNI's ``.head .brik``, ``.par .rec``, ``.mnc``, ``.mif .gipl``;
          with time steps or components per voxel ``?time= channel=``;
        - ``.vti .vtr .vtk .pvti .vtm .vtkhdf`` and ``.npz`` (``?dataset=`` if there are several
          arrays), ``.npy``, MRC and CCP4 maps (``.mrc .map .rec .st``; ``?time=`` of a stack);
        - raw bytes as ``FILE.raw?shape=XxYxZ&dtype=uint8&spacing=1,1,1`` (also ``&offset=``
          bytes and ``&order=big``);
        - a folder of DICOM slices, or one file of a series: ``FOLDER?series=NUMBER`` (or its UID)
          if there are several series, ``?time=N`` if slices share their positions; or a file of
          many frames, or a segmentation. In a folder without slices, folders below are searched,
          down to three levels. Oblique and tilted stacks are not resampled; a tilted gantry results
          in a sheared lattice;
        - a TIFF file, with ImageJ's and OME-TIFF's spacing: ``?spacing= channel= time=``, and
          ``series=N`` if there are several stacks, ``axes=ZYX`` if its axes have no names; or a
          folder of TIFF, PNG, BMP, JPEG or JPEG 2000 pictures in the order of the numbers in their
          names (``z2`` before ``z10``), which may number channels and times, too; or one of these;
        - an HDF5 file, ``.h5 .hdf5 .he5 .nxs``: ``?dataset= time= channel= spacing=``; a dataset
          has the axes that ilastik, NeXus or BigDataViewer (``.xml``) state, else (Z, Y, X) or
          (T, Z, Y, X), and its spacing is ``element_size_um`` or theirs. Also Imaris' ``.ims``.
          Needs ``volspec[hdf5]``;
        - an OME-Zarr (0.4, 0.5), a plain Zarr array or N5: a folder, a ``.zarr.zip`` or ``.ozx``
          file, or a URL (``https://…``, ``s3://…``): ``?level= channel= time= spacing=``, of others
          ``dataset= axes=``. Needs ``volspec[zarr]``, a URL ``volspec[remote]``;
        - a microscope's ``.czi .lif .nd2 .oib .oif``: ``?series= channel= time=``. Needs
          ``volspec[micro]``;
        - the name of a bundled volume, if no file has it: ``engine``, ``head`` or ``frog``.

    A single slice is repeated behind itself, which is one of its `Metadata.assumed`.

    A volume that takes more memory than ``memory=2GiB`` (OME-Zarr: by default 2 GiB; uncompressed
    files: half of what is free) is not read as a whole: a coarse level is, and casts read what
    they show of the finer ones (`Volume.pyramid`).

    Raises
    ------
    VolumeError
        If the file is missing, truncated, of unknown format, not 3-D, constant, or its
        spacing is not positive; if there are several series, channels or time steps and none is
        named, or slices are missing.
    DeviceError
        If the library of its format is not installed, such as zarr or h5py.
    """
    volume, notes = _read_volume(path)
    low, high = volume.range
    if low == high and not volume.fields:
        raise VolumeError(
            f"{volume.name}: every voxel is {low:g}, so there is nothing to show; was the right "
            "file or channel given?",
            code="range",
        )
    for note in notes:
        warnings.warn(note, VolspecWarning, stacklevel=2)
    return volume


def load_step(path: str | os.PathLike[str], number: int) -> Volume:
    """Read a time step as `load_volume` reads a volume; it may be uniform, as at a beginning.

    Remarks on the file are made on its first step, number 0.
    """
    volume, notes = _read_volume(path, uniform=True)
    for note in notes if number == 0 else ():
        warnings.warn(note, VolspecWarning, stacklevel=2)
    return volume


def _read_volume(path: str | os.PathLike[str], uniform: bool = False) -> tuple[Volume, list[str]]:
    """Return a volume, or all channels of one, and notes on it; ``uniform`` ones if asked."""
    query, library = _query(path)
    notes: list[str] = []
    try:
        volume = _read_field(query, library, str(query.path), notes)
    except VolumeError as error:
        if error.code != "missing" or not (names := _open_channels(query, library)):
            raise
        volume = _read_channels(query, library, names, notes, uniform)
    return volume, list(dict.fromkeys(notes))


def _open_channels(query: Query, library: str) -> list[str]:
    """Return the names of a file's channels if it is open which to read, and nothing else is."""
    listed = choices_in_child(query) if library else _list_choices(query)
    if any(choice.chosen is None for choice in listed):
        return []
    channel = next((c for c in listed if c.key == "channel" and c.chosen == ALL), None)
    if channel is None:
        return []
    named = zip(channel.values, channel.names, strict=True)
    titles = [f"channel {name}" if name == value else name for value, name in named]
    return unique_titles(titles[1:])


def _read_channels(
    query: Query, library: str, names: list[str], notes: list[str], uniform: bool
) -> Volume:
    """Read all channels of a file as the fields of one volume; ``uniform`` ones only if asked."""
    fields: list[Volume] = []
    for number, name in enumerate(names):
        one = replace(query, options={**query.options, "channel": str(number)})
        of_field: list[str] = []
        try:
            field = _read_field(one, library, name if fields else str(query.path), of_field)
        except VolumeError as error:
            if error.code != "range":
                raise
            reason = str(error).partition(": ")[2]
            notes.append(f"{query.path}: channel {number} ({name}) is left out: {reason}")
            continue
        notes += [] if number else of_field  # those on a file are the same for all channels
        low, high = field.range
        if low < high or uniform:
            fields.append(field)
        else:
            notes.append(
                f"{query.path}: channel {number} ({name}) is left out, as every voxel is {low:g}"
            )
    if not fields:
        raise VolumeError(
            f"{query.path}: in every channel all voxels are alike, so there is nothing to show",
            "give another file",
            code="range",
        )
    first, *further = fields
    return first.with_fields(further)


def _read_field(query: Query, library: str, name: str, notes: list[str]) -> Volume:
    """Read the field that an address selects, and add notes on it."""
    reading = None
    if (stack := _larger(query)) is None:
        reading = read_in_child(query) if library else read_here(query)
        stack = stored_stack(query, reading)
    if stack is not None:
        _require_linear(query)
        volume = read_coarsest(query, name, stack, notes)
        return _with_labels(volume, query, stack.labels, notes)
    assert reading is not None
    notes += reading.notes
    values = reading.values
    if isinstance(values, Stored):
        query.reserve(values.shape, np.dtype(values.dtype).itemsize)
        values = values.read()
    values, reading = with_depth(values, reading, query)
    certain = query.labels is not None or reading.labels is not None
    channel, missing = reading.channel or Channel(), None
    numbers: tuple[int, ...] = ()
    if query.is_log:
        values, missing, note = logarithms(values, name)
        notes += filter(None, [note])
        channel = channel.on_log_scale()
    else:
        values, numbers = renumber_labels(values, certain)
    volume = Volume(
        values,
        spacing_mm=reading.spacing_mm,  # type: ignore[arg-type]
        world_from_index=reading.world_from_index,  # type: ignore[arg-type]
        name=name,
        channel=channel,
        metadata=query.completed(reading.metadata),
        missing=missing,
        numbers=numbers,
    )
    if query.spacing_mm is not None:
        volume = volume.with_spacing(query.spacing_mm)
    return _with_labels(volume, query, reading.labels, notes)


def _require_linear(query: Query) -> None:
    """Refuse logarithms of what is read in parts."""
    if query.is_log:
        raise VolumeError(
            f"{query.path}: is read in parts, of which no logarithms are taken",
            "leave out scale=log; to show it, give a coarser level or more memory=",
            code="unsupported",
        )


def _larger(query: Query) -> Stack | None:
    """Return the levels of a file that is larger than memory, without reading its voxels."""
    find = _format(query).stack
    return None if find is None else find(query)


def open_level(path: str | os.PathLike[str]) -> tuple[Level, str, Labels, Metadata]:
    """Return a volume's finest level, name, labels and metadata; what is too large is not read.

    Errors and warnings are those of `load_volume`; only one channel is read.
    """
    query, library = _query(path)
    query = replace(query, memory_bytes=query.memory_bytes or _CONVERTED_BYTES)
    _require_linear(query)
    stack = _larger(query)
    if stack is None and not library:
        stack = stored_stack(query, read_here(query))
    if stack is not None:
        level = stack.levels[0]
        if query.spacing_mm is not None:
            spacing = np.linalg.norm(level.world_from_index[:3, :3], axis=0)
            factors = np.diag([*np.divide(query.spacing_mm, spacing), 1.0])
            level = replace(level, world_from_index=level.world_from_index @ factors)
        return level, query.path.name, stack.labels or {}, query.completed(stack.metadata)
    volume = load_volume(path)
    if volume.fields:
        raise VolumeError(
            f"{query.path}: has {len(volume.fields) + 1} channels, of which one is converted",
            f"choose it with {query.example(channel='0')}",
            code="missing",
        )
    labels = dict(volume.labels)
    if volume.numbers:  # of which a volume that is larger than memory has only the names
        numbered = {n: replace(row, name=f"{n} {row.name}".strip()) for n, row in labels.items()}
        labels = {volume.value_of(n): label for n, label in numbered.items()}
    return level_of(volume), query.path.name, labels, volume.metadata


def _with_labels(
    volume: Volume, query: Query, in_header: Labels | None, notes: list[str]
) -> Volume:
    """Add the labels of a segmentation, from a given table, the header, or tables next to it."""
    path, named = query.path, query.labels
    named_labels = {} if named is None else read_label_table(path.parent / named)
    beside: Mapping[Path, Labels] = {} if query.is_remote else labels_beside(path)
    tables = {path.parent / named: named_labels} if named is not None else beside
    names: Labels = in_header or {} if named is None else {}
    for table in tables.values():
        names = merge_labels(names, table)
    certain = named is not None or in_header is not None
    labels = find_labels(volume.values, volume.range, names, certain, volume.numbers)
    larger = volume.pyramid is not None
    why = "" if labels else why_no_labels(volume.values, volume.range, certain, larger)
    if named is not None and not labels:
        raise VolumeError(
            f"{path}: its values are no labels: {why or 'they are not whole numbers'}",
            "or leave out labels=",
            code="conflict",
        )
    if why:
        notes.append(f"{path}: is shown as values, not as labels, as its {why}")
    if named is not None and not labels.keys() & named_labels.keys():
        numbers = [str(number) for number in sorted(named_labels) if number]
        listed = ", ".join(numbers[:_MAX_NUMBERS]) + ", …" * (len(numbers) > _MAX_NUMBERS)
        low, high = volume.stated(volume.range)
        raise VolumeError(
            f"{named}: none of its numbers ({listed or 0}) is a value of {path.name} "
            f"({low:g} … {high:g}); is it the table of another volume?",
            code="conflict",
            given=named,
        )
    notes += _partial_table(path, labels, tables)
    return replace(volume, labels=labels) if labels else volume


def _partial_table(path: Path, labels: Labels, tables: Mapping[Path, Labels]) -> list[str]:
    """Return a note if tables leave many labels without a name: they may be another volume's."""
    named = {number for number, label in labels.items() if label.name}
    if len(named) >= NAMED * len(labels):
        return []
    for table, rows in tables.items():
        if count := sum(rows[number].name != "" for number in named & rows.keys()):
            return [
                f"{table} names {count} of the {len(labels)} labels of {path}; is it the table of "
                "another volume?"
            ]
    return []


def volume_choices(path: str | os.PathLike[str]) -> tuple[Choice, ...]:
    """List what an address leaves open: series, level, channel, time step, layout of raw bytes.

    Headers are read, voxels are not. Choices with a single value are left out. A choice that
    depends on another is listed once the other is given: the time steps of a DICOM series, once
    ``series=`` is. The key of raw bytes without a layout is ``shape``, with no values;
    ``?shape=XxYxZ&dtype=uint8`` gives it.

    Raises
    ------
    VolumeError
        If the file is missing, damaged, of unknown format, or cannot be a volume.
    """
    query, library = _query(path)
    # The metadata of a Zarr are JSON, which no native library reads.
    return choices_in_child(query) if library and library != "zarr" else _list_choices(query)


def _list_choices(query: Query) -> tuple[Choice, ...]:
    listed: list[Choice] = []
    with suppress(ChoicesListed):
        read_here(replace(query, choices=listed))
    return tuple(listed)


def _query(path: str | os.PathLike[str]) -> tuple[Query, str]:
    """Return an address as a query, and the module that reads it; empty if NumPy alone does."""
    query = Query.of(locate_volume(os.fspath(path)))
    if not is_bundled(query.path):
        require_links_inside(query.path, VolumeError)
    kind = _format(query)
    if query.path.is_dir() and kind in (formats.DICOM, formats.SLICES):
        for folder in series_folders(query.path) or (query.path,):
            require_slices(folder, formats.SLICE_SUFFIXES)
    if formats.HDF5 in kind.magic:
        require_parts_inside(query.path)
    if kind.library in _UTF_8:
        _require_utf_8(query.path)
    return query, kind.library


def read_here(query: Query) -> Reading:
    """Read a file in this process, unprotected from crashes of the format's library."""
    return _format(query).read(query)


# Readers that open only files whose names are UTF-8.
_UTF_8 = ("pyvista",)


def _require_utf_8(path: Path) -> None:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise VolumeError(
            f"{quote(str(path), 200)}: its name is not UTF-8, and the library that reads it opens "
            "no other names; rename it, or work in a UTF-8 locale",
            code="unsupported",
        ) from None


def reader_library(query: Query) -> str:
    """Return the module that reads a file; empty if NumPy alone reads it."""
    return _format(query).library


def _format(query: Query) -> formats.Format:
    """Return the format of a file or folder; refuse what is no volume."""
    path = query.path
    if query.is_remote:
        return formats.OME_ZARR
    _require_readable(query)
    if path.is_dir():
        return _folder_format(path)
    if not path.is_file():
        raise VolumeError(f"{path}: is a pipe or a device; give a file or a folder", code="type")
    head = require_contents(path)
    if not head:
        raise VolumeError(f"{path}: the file is empty; copy or download it again", code="damaged")
    kind, lower = formats.format_of(path, head), path.name.lower()
    hints = () if lower.endswith(formats.VOLUME_SUFFIXES) or query.options else _ADVICE.items()
    advice = next((text for ends, text in hints if lower.endswith(ends)), "")
    # Some of the others are HDF5 or TIFF, whose readers do not know what they state.
    if advice and kind is not formats.DICOM:
        vti = os.path.splitext(path)[0] + ".vti"
        names = {"path": str(path), "vti": vti, "shell": shlex.quote(str(path))}
        raise VolumeError(f"{path}: {advice.format(**names)}", code="unsupported")
    if kind is None and query.options:
        return formats.RAW
    any_bytes = kind is None or kind.unpacks or kind is formats.RAW
    if head.startswith(GZIP) and not any_bytes:
        target = path.with_name(f"unpacked-{path.name}")
        raise VolumeError(
            f"{path}: is packed by gzip, though its name does not say so",
            f"unpack it: gunzip -c {shlex.quote(str(path))} > {shlex.quote(str(target))}",
            code="unsupported",
        )
    if kind is None:
        raise VolumeError(f"{path}: unknown format; supported are {_KNOWN}", code="unknown")
    return kind


def _require_readable(query: Query) -> None:
    """Refuse a file or folder that does not exist, or that the user may not read."""
    path = query.path
    try:
        exists = path.exists()
        readable = os.access(path, os.R_OK | os.X_OK if path.is_dir() else os.R_OK)
    except PermissionError:  # of a folder on the way
        exists, readable = True, False
    if not exists and path.is_symlink():
        require_contents(path)
    if not exists:
        remedy = f"{nearest_file(path, _NEVER_VOLUMES)}check the path"
        if empty := [key for key, value in query.options.items() if not value]:
            path = Path(f"{path}?{empty[0]}")
            remedy = "give one file, as ? begins options, KEY=VALUE"
        raise VolumeError(f"{path}: no such file", remedy, code="not-found")
    if not readable:
        raise VolumeError(
            f"{path}: no permission to read it; change its permissions (chmod u+r), or copy it as "
            "its owner",
            code="unreadable",
        )


def _folder_format(folder: Path) -> formats.Format:
    try:
        if is_zarr(folder):
            return formats.OME_ZARR
        if not dicom_files(folder) and pictures_in(folder):
            return formats.SLICES
        if series_folders(folder):
            return formats.DICOM
        require_slices(folder, formats.SLICE_SUFFIXES)
        volumes = sorted(
            path.name
            for path in folder.iterdir()
            if path.name.lower().endswith(formats.WHOLE_SUFFIXES) and not path.name.startswith(".")
        )
    except OSError as error:
        raise VolumeError(
            f"{error.filename}: cannot be read: {error.strerror}; check its permissions",
            code="unreadable",
        ) from error
    if volumes:
        contents = f"{len(volumes)} volumes" if len(volumes) > 1 else "a volume"
        raise VolumeError(
            f"{folder}: holds {contents}; name one, such as {folder / volumes[0]}", code="missing"
        )
    endings = dict.fromkeys(path.suffix.lower() or path.name for path in sorted(folder.iterdir()))
    if not endings:
        raise VolumeError(f"{folder}: is an empty folder; check the path", code="not-found")
    holds = ", ".join([*endings][:_MAX_NUMBERS]) + ", …" * (len(endings) > _MAX_NUMBERS)
    raise VolumeError(
        f"{folder}: holds {holds}, but no slices (DICOM, TIFF, PNG, BMP, JPEG); give the folder "
        f"that holds them, or a file ({_KNOWN})",
        code="not-found",
    )
