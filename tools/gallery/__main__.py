"""Remake docs/gallery: ``python -m tools.gallery [--only NAME] [--draft FOLDER]``."""

from __future__ import annotations

import argparse
from pathlib import Path

from tools.gallery import fields, layers, light, matter, page, rays, studio
from tools.gallery.studio import READERS, ROOT, Feature

FOLDER = ROOT / "docs" / "gallery"
FEATURES = (
    Feature("Shadows", light.shadows),
    Feature("Light groups", light.light_groups),
    Feature("Cuts", rays.cuts),
    Feature("Isosurfaces", matter.isosurfaces),
    Feature("Value and gradient", matter.boundaries),
    Feature("Labels", matter.labels),
    Feature("Pre-integration", rays.preintegration),
    Feature("Projections", rays.projections),
    Feature("Coloured glass", matter.coloured_glass),
    Feature("Ambient occlusion", light.ambient_occlusion),
    Feature("Depth and cameras", rays.depth),
    Feature("Metamers", light.metamers),
    Feature("Fluorescence", fields.fluorescence),
    Feature("PET in CT", fields.pet_in_ct),
    Feature("A segmentation over its CT", fields.organs_in_ct),
)
LAYERS = (
    Feature("An engine's block", layers.engine_block),
    Feature("Skin and flesh", layers.skin_and_flesh),
    Feature("A plate on a bone", layers.a_plate_on_a_bone),
)
PAGES = (
    page.Page("raycast.md", FEATURES, page.TOP, studio, page.CREDITS),
    page.Page("layers.md", LAYERS, page.LAYERS_TOP, layers),
)


def main() -> None:
    """Make the pictures whose volumes are available, then the pages."""
    features = (*FEATURES, *LAYERS)
    names = [feature.name for feature in features]
    parser = argparse.ArgumentParser(prog="python -m tools.gallery", description=__doc__)
    parser.add_argument("--only", choices=names, nargs="+", default=names, metavar="NAME")
    parser.add_argument("--draft", type=Path, metavar="FOLDER", help="small pictures, elsewhere")
    options = parser.parse_args()
    if options.draft:
        studio.SIZE = (800, 600)
    folder = options.draft or FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for feature in features:
        if feature.name in options.only:
            remake(feature, folder)
    for each in PAGES:
        page.write(each, folder)


def remake(feature: Feature, folder: Path) -> None:
    """Cast and save a feature's pictures, or print the reason for keeping the old ones."""
    try:
        volumes = [READERS[name]() for name in feature.volumes]
    except (FileNotFoundError, ImportError) as error:
        print(f"{feature.name}: skipped, its pictures stay: {error}", flush=True)
        return
    pictures = feature.make(*volumes)
    note = page.save(feature, pictures, folder)
    print(f"{feature.name}: {note}", flush=True)


if __name__ == "__main__":
    main()
