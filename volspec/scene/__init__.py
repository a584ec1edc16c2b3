"""Scene files: everything a picture needs, in one TOML file."""

from volspec.scene.model import NamedLight, Scene, viewing_of
from volspec.scene.tables import SceneFile

__all__ = ["NamedLight", "Scene", "SceneFile", "viewing_of"]
