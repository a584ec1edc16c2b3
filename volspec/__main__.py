"""``python -m volspec``: the command line."""

from volspec.cli import main

main()
