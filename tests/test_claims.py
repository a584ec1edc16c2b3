"""Figures of colour in the documents: each is what its command prints today, to its last digit."""

import re
import shlex
from itertools import starmap
from pathlib import Path

import pytest

from benchmarks import basis as bases
from benchmarks.claims import CLAIMS, PRINTED, Claim, catalogue, holds, page_text
from benchmarks.claims.spectra import general
from benchmarks.measure import between
from tests.support.commands import call

ROOT = Path(__file__).resolve().parent.parent
PAGES = ["README.md", *sorted(path.name for path in (ROOT / "docs").glob("*.md"))]
# Their figures are written between markers by the command itself.
GENERATED = {"benchmarks.md"}
# A limit of the program, not a result.
LIMITS = ("if they meet every cell (to ΔE 0.5, CIELAB)",)
# At half a second or more of computation.
SLOW = (
    *("luts_under_narrow_lights", "fields/48", "fields/32", "jump_of_a_blue", "round_trips"),
    *("checker/jakob-2019", "local_adaptation", "step_across_the_hull"),
)
COLOUR = re.compile(r"(?:CIEDE2000|CIE94|ΔE\w*|Δu'v')(?=[^|]*?(?<![\w.])\d*\.\d)")


def is_slow(claim: Claim) -> bool:
    """Return True for a claim that `make test` leaves out; those of the README are in it."""
    return claim.slow or (claim.name in SLOW and claim.page != "README.md")


@pytest.mark.parametrize(
    "claim",
    [
        pytest.param(each, id=each.name, marks=[pytest.mark.slow] if is_slow(each) else [])
        for each in CLAIMS
    ],
)
def test_a_figure_is_what_is_computed_to_its_last_digit(claim):
    assert claim.misses() == []


def test_every_claim_has_a_name_of_its_own():
    names = [each.name for each in CLAIMS]
    assert sorted(set(names)) == sorted(names)


@pytest.mark.parametrize("each", PRINTED, ids=lambda each: f"{each.page}: {each.text[:30]}")
def test_figures_of_commands_are_on_their_page_and_the_test_is_there(each):
    assert page_text(each.page).count(each.text) == 1
    assert (ROOT / each.test).exists()
    words = shlex.split(each.command)
    if words[:2] == ["python", "-m"] and words[2] != "pytest":
        module = ROOT / words[2].replace(".", "/")
        assert module.with_suffix(".py").exists() or (module / "__main__.py").exists()


@pytest.mark.parametrize("page", PAGES)
def test_a_paragraph_with_a_colour_difference_is_in_the_catalogue(page):
    """Words around a figure may change; then its claim must, too. Transcripts are apart."""
    known = [each.text for each in catalogue() if each.page == page]
    path = ROOT / page if page == "README.md" else ROOT / "docs" / page
    text = re.sub(
        r"<!-- (\w+) -->.*?<!-- /\1 -->|```.*?```", "", path.read_text(encoding="utf-8"), flags=re.S
    )
    blocks = [" ".join(block.split()) for block in text.split("\n\n")]
    bare = [
        block
        for block in blocks
        if COLOUR.search(block) and not any(words in block for words in (*known, *LIMITS))
    ]
    assert page in GENERATED or bare == []


_FIGURE = re.compile(r"\d*\.?\d+")


def words_and_figures(line: str) -> tuple[list[str], list[str]]:
    """Return the words of a line, without its figures, and the figures."""
    return _FIGURE.sub("", line).split(), _FIGURE.findall(line)


def alike(shown: str, printed: str) -> bool:
    """Return True if lines have the same words, and figures to one unit of their last digits."""
    (words, figures), (others, now) = map(words_and_figures, (shown, printed))
    return (
        words == others and len(figures) == len(now) and all(map(holds, figures, map(float, now)))
    )


@pytest.mark.parametrize("size", bases.SIZES)
def test_the_rows_of_general_bases_are_what_the_report_gives(size):
    page = between(bases.PAGE.read_text(encoding="utf-8"), "modes").splitlines()
    for mode in ("fitted", "componentwise", "exact"):
        name = f"`general-{size}`, {mode}"
        (shown,) = (line for line in page if line.startswith(f"| {name} |"))
        assert alike(shown, bases.row(name, general(size), mode))
    rgb = bases.row("RGB light × RGB surface (sharp sensors)", general(size), bases.RGB_PRODUCT)
    assert alike(page[3], rgb)


@pytest.mark.slow
@pytest.mark.parametrize("name", bases.TABLES)
def test_the_tables_of_bases_are_what_the_benchmark_prints(name):
    shown = between(bases.PAGE.read_text(encoding="utf-8"), name).split("\n")[3:-1]
    assert all(starmap(alike, zip(shown, bases.TABLES[name](), strict=True)))


def transcripts(page: str) -> list[tuple[str, str]]:
    """Return the commands of a page and what it shows of their output."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"```\n(\$ volspec .*?)```", text, re.DOTALL)
    return [
        pair
        for block in blocks
        for pair in re.findall(r"^\$ volspec (.*)\n((?:(?!\$ ).*\n?)*)", block, re.MULTILINE)
    ]


SHOWN = [
    pytest.param(page, *pair, id=pair[0], marks=[pytest.mark.slow] if "gallery" in page else [])
    for page in ("models.md", "gallery/palette.md")
    for pair in transcripts(page)
]


@pytest.mark.parametrize(("page", "command", "shown"), SHOWN)
def test_commands_print_what_the_page_shows(page, command, shown, tmp_path, capsys, monkeypatch):
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    assert call(*shlex.split(command)) == 0
    said = capsys.readouterr()
    printed = (said.out + said.err).splitlines()
    lines = [line for line in shown.splitlines() if line]
    assert [line for line in lines if not any(alike(line, each) for each in printed)] == []
