"""Scene files: everything a picture needs, in one TOML file."""

from volspec.scene.file import SceneFile
from volspec.scene.lights import NamedLight
from volspec.scene.model import Scene, stored_look, stored_relight_spec
from volspec.scene.writing import write_scene

__all__ = ["NamedLight", "Scene", "SceneFile", "stored_look", "stored_relight_spec", "write_scene"]
