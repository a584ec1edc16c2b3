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
        return [_simple(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    simple = {key: value for key, value in schema.items() if key not in ("discriminator", "title")}
    # Tables need no default: their keys have defaults.
    if isinstance(simple.get("default", {}), dict | type(None)):
        simple.pop("default", None)
    if "description" in simple:
        simple["description"] = simple["description"].split("\n\n")[0].replace("``", "`")
    if "properties" in simple or "$defs" in simple:
        # The keys here are names of keys and tables, not keywords of a schema.
        for key in ("properties", "$defs"):
            simple |= {key: {name: _simple(part) for name, part in simple.get(key, {}).items()}}
        simple = {key: value for key, value in simple.items() if value != {}}
        return {
            key: value if key in ("properties", "$defs") else _simple(value)
            for key, value in simple.items()
        }
    if "anyOf" in simple and _NULL in simple["anyOf"]:
        types = [part for part in simple.pop("anyOf") if part != _NULL]
        simple = {**(types[0] if len(types) == 1 else {"anyOf": types}), **simple}
    if "const" in simple:
        simple["enum"] = [simple.pop("const")]
    if "prefixItems" in simple:
        # Pairs and vectors: all entries have the same type.
        simple["items"] = simple.pop("prefixItems")[0]
    if "$ref" in simple and len(simple) > 1:
        simple = {"allOf": [{"$ref": simple.pop("$ref")}], **simple}
    return {key: _simple(value) for key, value in simple.items()}
