"""Inputs that fuzzing found, which tests replay: ``tests/fuzz/corpus.tar.xz``.

    fuzz -> [fuzz_corpus] -> fuzz_child, tests/fuzz/test_fuzz.py

To add a finding, run ``python -m benchmarks.fuzz TARGET --keep``, or ``add_inputs("TARGET",
[path.read_bytes()])`` for a file that was found elsewhere, and commit the archive. A member is
``TARGET/SHA1``; the archive is the same bytes for the same inputs, in whatever order they came.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Iterable
from pathlib import Path

CORPUS = Path(__file__).resolve().parents[1] / "tests/fuzz/corpus.tar.xz"


def read_corpus(archive: Path = CORPUS) -> dict[str, dict[str, bytes]]:
    """Return the inputs of every target by their names, both in order."""
    corpus: dict[str, dict[str, bytes]] = {}
    with tarfile.open(archive) as tar:
        for member in tar:
            target, _, name = member.name.partition("/")
            file = tar.extractfile(member)
            assert file is not None, f"{member.name} is no file"
            corpus.setdefault(target, {})[name] = file.read()
    return corpus


def kept_inputs(target: str) -> dict[str, bytes]:
    """Return the inputs of a target by name; none if the target is new."""
    return read_corpus().get(target, {})


def add_inputs(target: str, inputs: Iterable[bytes], archive: Path = CORPUS) -> None:
    """Add inputs of a target, and write the archive again."""
    corpus = read_corpus(archive) if archive.exists() else {}
    named = {hashlib.sha1(data).hexdigest()[:16]: data for data in inputs}
    corpus[target] = corpus.get(target, {}) | named
    with tarfile.open(archive, "w:xz") as tar:
        for folder in sorted(corpus):
            for name, data in sorted(corpus[folder].items()):
                member = tarfile.TarInfo(f"{folder}/{name}")
                member.size = len(data)
                tar.addfile(member, io.BytesIO(data))
