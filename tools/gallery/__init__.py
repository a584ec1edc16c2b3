"""The picture page of the raycaster: ``python -m tools.gallery`` remakes docs/gallery.

    features (light, matter, rays) -> studio (cast, show) -> pictures -> page

A feature is a function of the volumes that it names. Its docstring is the caption and its body
the code that the page prints, so that picture, words and code cannot part.
"""
