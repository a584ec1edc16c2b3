"""The pages of docs/gallery that tools/gallery writes."""

import json
import re

import pytest

from tests.test_claims import alike
from tools.gallery import page, studio
from tools.gallery.__main__ import FOLDER, LAYERS, PAGES
from tools.gallery.studio import READERS

_MAX_BYTES = 300_000


@pytest.mark.parametrize("each", PAGES, ids=lambda each: each.file)
def test_a_page_is_what_its_features_write(each, tmp_path):
    """A changed caption or code makes `python -m tools.gallery --only NAME` due."""
    casts = (FOLDER / "casts.json").read_text(encoding="utf-8")
    (tmp_path / "casts.json").write_text(casts, encoding="utf-8")
    page.write(each, tmp_path)
    written = (tmp_path / each.file).read_text(encoding="utf-8")
    assert written == (FOLDER / each.file).read_text(encoding="utf-8")
    pictures = [FOLDER / name for name in re.findall(r"\]\(([\w-]+\.jpg)\)", written)]
    assert pictures and all(0 < path.stat().st_size <= _MAX_BYTES for path in pictures)


@pytest.mark.slow
@pytest.mark.parametrize("feature", LAYERS, ids=lambda feature: feature.name)
def test_differences_of_layers_and_casts_are_those_of_the_page(feature):
    try:
        volumes = [READERS[name]() for name in feature.volumes]
    except FileNotFoundError as error:
        pytest.skip(str(error))
    labels = list(feature.make(*volumes))
    shown = json.loads((FOLDER / "casts.json").read_text(encoding="utf-8"))[feature.name]
    assert shown["size"] == list(studio.SIZE)
    assert [one for one in zip(shown["labels"], labels, strict=True) if not alike(*one)] == []
