# What other packages use of this one; lazy_loader and type checkers read it.
from .catalogue import (
    EVERYDAY as EVERYDAY,
    canonical_light as canonical_light,
    describe_light as describe_light,
    library_names as library_names,
    nearest_light as nearest_light,
    search_lights as search_lights,
)
from .fluorophores import FLUOROPHORE as FLUOROPHORE
from .lamps import (
    LAMP as LAMP,
    LAMPS as LAMPS,
    flux_lm as flux_lm,
    lamp_for_light as lamp_for_light,
    lamp_illuminance_lux as lamp_illuminance_lux,
    lumens_per_watt as lumens_per_watt,
)
from .lights import (
    as_light as as_light,
    light as light,
    light_set as light_set,
    light_terms as light_terms,
    rebase_light as rebase_light,
    sent_name as sent_name,
    sent_names as sent_names,
)
from .reflectances import (
    as_reflectance as as_reflectance,
    reflectance as reflectance,
    reflectance_names as reflectance_names,
    reflectance_set as reflectance_set,
    reflectance_set_names as reflectance_set_names,
    reflectance_sets as reflectance_sets,
)
