"""What a compiler says, in one line that shows the line it is about."""

from __future__ import annotations

import re

from volspec._gpu.sources import Source
from volspec.errors import one_line

# "FILE:12:5: error: …" is clang's form, "error: FILE:12:5: …" PoCL's.
_COMPLAINT = re.compile(
    r"^(?:(?:fatal )?error: )?([^:\n]+):(\d+):(\d+): (?:(?:fatal )?error: )?(.*)$", re.MULTILINE
)
_MARK = re.compile(r'#line (\d+) "([^"]+)"')


def complaint(log: str, source: Source) -> str:
    """The compiler's first complaint in one line, with the text of the source line."""
    found = next((m for m in _COMPLAINT.finditer(log) if "error: " in m[0]), None)
    if found is None:
        return one_line(log)
    # The compiler has a name of its own for what stands before the first mark.
    file = found[1] if found[1] in source.files else source.files[0]
    name, number = source.files[0], 0
    for line in source.text.splitlines():
        if mark := _MARK.match(line):
            number, name = int(mark[1]) - 1, mark[2]
            continue
        number += 1
        if (name, number) == (file, int(found[2])):
            return f'{file}:{number}:{found[3]}: error: {found[4]}: "{line.strip()}"'
    return one_line(found[0])
