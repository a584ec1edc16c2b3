"""Commands in the guide print what it shows."""

import re
import shlex
from pathlib import Path

import pytest

from tests.support.commands import call

DOCS = Path(__file__).resolve().parents[2] / "docs"
SHOWN = {
    command: printed.splitlines()
    for page in ("appearance.md", "viewing.md", "reflectance.md")
    for command, printed in re.findall(
        r"```\n\$ volspec (.*?)\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL
    )
}


@pytest.mark.parametrize("command", SHOWN)
def test_commands_print_what_the_guide_shows(command, capsys):
    assert call(*shlex.split(command)) == 0
    said = capsys.readouterr()
    printed = [line.rstrip() for line in (said.out + said.err).splitlines()]
    assert printed == SHOWN[command]


def test_each_page_shows_one():
    assert {command.split()[0] for command in SHOWN} == {"appearance", "light", "reflectance"}
