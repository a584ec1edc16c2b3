"""JSON schema of scene files, for editors that complete and check TOML.

SceneFile -> [schema] -> data/scenes/scene.schema.json, volspec scene schema

TOML editors read the oldest drafts, so only keywords of all drafts are used.
"""

from __future__ import annotations

import json
from typing import Any

from volspec.scene.file import SceneFile
from volspec.settings import json_schema

_NULL = {"type": "null"}


def scene_schema() -> dict[str, Any]:
    """Return the schema; keys are described by the docstrings of the tables' fields."""
    return {"title": "volspec scene", **_simple(json_schema(SceneFile))}


def scene_schema_text() -> str:
    """Return the text of the shipped schema file."""
    return json.dumps(scene_schema(), indent=2, ensure_ascii=False) + "\n"


def _simple(schema: Any) -> Any:
    """Return a schema in keywords of all drafts, and without nulls, which TOML lacks."""
    if isinstance(schema, list):
        return [_simple(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    said = {key: value for key, value in schema.items() if key not in ("discriminator", "title")}
    # Tables need no default: their keys have defaults.
    if isinstance(said.get("default", {}), dict | type(None)):
        said.pop("default", None)
    if "description" in said:
        said["description"] = said["description"].split("\n\n")[0].replace("``", "`")
    if "properties" in said or "$defs" in said:
        # The keys here are names of keys and tables, not keywords of a schema.
        for key in ("properties", "$defs"):
            said |= {key: {name: _simple(each) for name, each in said.get(key, {}).items()}}
        said = {key: value for key, value in said.items() if value != {}}
        return {
            key: value if key in ("properties", "$defs") else _simple(value)
            for key, value in said.items()
        }
    if "anyOf" in said and _NULL in said["anyOf"]:
        others = [each for each in said.pop("anyOf") if each != _NULL]
        said = {**(others[0] if len(others) == 1 else {"anyOf": others}), **said}
    if "const" in said:
        said["enum"] = [said.pop("const")]
    if "prefixItems" in said:
        # Pairs and vectors: all entries have the same type.
        said["items"] = said.pop("prefixItems")[0]
    if "$ref" in said and len(said) > 1:
        said = {"allOf": [{"$ref": said.pop("$ref")}], **said}
    return {key: _simple(value) for key, value in said.items()}
