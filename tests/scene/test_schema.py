"""The JSON schema that ships with the scenes."""

import dataclasses
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tools import reference
from volspec.scene import SceneFile
from volspec.scene.schema import scene_schema_text
from volspec.scene.tables.transfer import KINDS
from volspec.settings import descriptions, file_keys
from volspec.volume.formats import FORMATS

SHIPPED = Path(__file__).resolve().parents[2] / "data" / "scenes" / "scene.schema.json"
SCHEMA: dict[str, Any] = json.loads(SHIPPED.read_text(encoding="utf-8"))


def tables(schema: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every table of the schema, by its keys."""
    if isinstance(schema, list):
        for each in schema:
            yield from tables(each, path)
    elif isinstance(schema, dict):
        if "properties" in schema:
            yield path, schema
        for key, each in schema.get("properties", {}).items():
            yield from tables(each, f"{path}.{key}")
        for key in ("items", "anyOf", "oneOf", "allOf"):
            yield from tables(schema.get(key), path)
        for key, each in schema.get("$defs", {}).items():
            yield from tables(each, key)


TABLES = dict(tables(SCHEMA))


@pytest.mark.not_quick
def test_it_is_up_to_date():
    assert SHIPPED.read_text(encoding="utf-8") == scene_schema_text(), reference.__doc__


@pytest.mark.parametrize("name", reference.PAGES)
def test_the_reference_pages_are_up_to_date(name):
    written = (reference.FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert written == reference.page(name), reference.__doc__


def test_the_table_of_formats_is_up_to_date_and_complete():
    page = (reference.FOLDER / "formats.md").read_text(encoding="utf-8")
    assert page == reference.formats_page(), reference.__doc__
    assert len(FORMATS) >= 30 and all(each.note for each in FORMATS)


@pytest.mark.parametrize("name", reference.PAGES)
def test_the_reference_describes_every_field(name):
    for cls in reference.PAGES[name][1].values():
        for field in dataclasses.fields(cls):
            assert descriptions(cls)[field.name].endswith("."), f"{cls.__name__}.{field.name}"


def test_every_table_and_every_key_is_described():
    for name, table in TABLES.items():
        assert table["description"], name
        for key, said in table["properties"].items():
            assert said["description"].endswith("."), f"{name}.{key}"


def test_it_knows_the_keys_of_a_scene_and_no_other():
    assert set(SCHEMA["properties"]) == set(file_keys(SceneFile))
    # Meshes may be alone, without [volume] and [transfer].
    assert set(SCHEMA["required"]) == {"material", "light"}
    assert set(KINDS) <= set(TABLES[".transfer"]["properties"])
    assert all(table["additionalProperties"] is False for table in TABLES.values())


def test_it_says_nothing_that_the_oldest_drafts_or_toml_have_no_word_for():
    words = re.findall(r'"([^"]*)"', SHIPPED.read_text(encoding="utf-8"))
    assert set(words).isdisjoint({"const", "prefixItems", "discriminator", "null", "$schema"})
    vector = TABLES[".raycast.clip_planes"]["properties"]["normal"]
    assert (vector["items"], vector["minItems"], vector["maxItems"]) == ({"type": "number"}, 3, 3)
