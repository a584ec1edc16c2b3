"""The JSON schema that ships beside the scenes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from volspec.scene import SceneFile
from volspec.scene.schema import scene_schema_text
from volspec.scene.transfer import KINDS

SHIPPED = Path(__file__).resolve().parent.parent / "data" / "scenes" / "scene.schema.json"
SCHEMA: dict[str, Any] = json.loads(SHIPPED.read_text(encoding="utf-8"))
TABLES: dict[str, dict[str, Any]] = {"": SCHEMA, **SCHEMA["$defs"]}


def test_it_is_up_to_date() -> None:
    assert SHIPPED.read_text(encoding="utf-8") == scene_schema_text(), (
        "run python -m tools.scene_schema"
    )


def test_every_table_and_every_key_is_described() -> None:
    for name, table in TABLES.items():
        assert table["description"], name
        for key, said in table["properties"].items():
            assert said["description"].endswith("."), f"{name}.{key}"


def test_it_knows_the_keys_of_a_scene_and_no_other() -> None:
    assert set(SCHEMA["properties"]) == set(SceneFile.model_fields)
    assert set(SCHEMA["required"]) == {"volume", "material", "transfer", "light"}
    assert set(KINDS) <= set(TABLES["TransferTable"]["properties"])
    assert all(table["additionalProperties"] is False for table in TABLES.values())


def test_it_says_nothing_that_the_oldest_drafts_or_toml_have_no_word_for() -> None:
    words = set(_words(SCHEMA))
    assert words.isdisjoint({"const", "prefixItems", "discriminator", "null", "$schema"})
    vector = TABLES["PlaneTable"]["properties"]["normal"]
    assert (vector["items"], vector["minItems"], vector["maxItems"]) == ({"type": "number"}, 3, 3)


def _words(schema: Any) -> list[str]:
    if isinstance(schema, dict):
        return [*schema, *(word for each in schema.values() for word in _words(each))]
    if isinstance(schema, list):
        return [word for each in schema for word in _words(each)]
    return [schema] if isinstance(schema, str) else []
