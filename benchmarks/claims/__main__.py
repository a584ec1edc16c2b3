"""The command line: ``python -m benchmarks.claims [NAME ...] [--slow] [--list]``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from benchmarks.claims import CLAIMS, catalogue


def print_catalogue() -> None:
    """Print the catalogue as a table."""
    print("| page | figures | printed by | checked by |\n|---|---|---|---|")
    for each in catalogue():
        text = each.text.replace("|", "\\|")
        print(f"| {each.page} | {text} | `{each.command}` | {each.test} |")


def report(names: Sequence[str], slow: bool) -> None:
    """Print the figures of claims whose names begin with one of those given, or of all."""
    for each in CLAIMS:
        chosen = each.name.startswith(tuple(names)) if names else slow or not each.slow
        if chosen:
            now = ", ".join(f"{value:.4g}" for value in each.compute())
            print(
                f"{each.name}: {now}\n    {each.page}: {', '.join(each.printed)}: {each.text}",
                flush=True,
            )


if __name__ == "__main__":
    if "--list" in sys.argv:
        print_catalogue()
    else:
        report([name for name in sys.argv[1:] if name != "--slow"], "--slow" in sys.argv)
