# What other packages use of this one; lazy_loader and type checkers read it.
from . import phantom as phantom
from .bundled import bundled_volume as bundled_volume, locate_volume as locate_volume
from .channels import Channel as Channel, MAX_FIELDS as MAX_FIELDS, unique_titles as unique_titles
from .files.query import Choice as Choice
from .formats import VOLUME_SUFFIXES as VOLUME_SUFFIXES, WHOLE_SUFFIXES as WHOLE_SUFFIXES
from .labels import Labels as Labels, are_whole as are_whole, find_labels as find_labels
from .load import (
    load_step as load_step,
    load_volume as load_volume,
    open_level as open_level,
    volume_choices as volume_choices,
)
from .metadata import Metadata as Metadata, ONE_SLICE as ONE_SLICE
from .model import Volume as Volume, block_modes as block_modes, downsample as downsample
from .series import (
    JOINER as JOINER,
    KEPT_BYTES as KEPT_BYTES,
    Known as Known,
    PATTERN as PATTERN,
    Series as Series,
    differ_in_numbers as differ_in_numbers,
    is_pattern as is_pattern,
    load_at as load_at,
    load_series as load_series,
    open_volume as open_volume,
    order_steps as order_steps,
    require_step as require_step,
    series_address as series_address,
    step_addresses as step_addresses,
    volume_or_steps as volume_or_steps,
)
from .summary import summarise as summarise, value_form as value_form, value_text as value_text
