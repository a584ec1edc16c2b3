# What other packages use of this one; lazy_loader and type checkers read it.
from .basis import grid_of as grid_of
from .fields import FieldSpec as FieldSpec, open_fields as open_fields
from .file import (
    SceneFaults as SceneFaults,
    SceneFile as SceneFile,
    scene_data as scene_data,
    scene_file as scene_file,
)
from .meshes import MeshCache as MeshCache
from .model import (
    Scene as Scene,
    cast_notes as cast_notes,
    stored_look as stored_look,
    stored_relight_spec as stored_relight_spec,
)
from .resolve import Resolver as Resolver
from .room import SceneRoom as SceneRoom
from .schema import scene_schema_text as scene_schema_text
from .tables.lights import NamedLight as NamedLight
from .writing import write_scene as write_scene
