"""Parts shared by all commands: the app, its options, progress bars, JSON, exit codes.

Exit codes: 0 done; 1 bad input, such as an option's value, or missing device (one line on stderr;
``--debug`` shows the traceback); 2 usage: an unknown command or option, or a missing argument; 130
interrupted; 141 if the reader closed the pipe, as `| head` does.
"""

from __future__ import annotations

import atexit
import codecs
import io
import json
import math
import os
import re
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from typing import Annotated, Any, NoReturn, get_args

from cyclopts import (
    App,
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    Parameter,
    Token,
    UnusedCliTokensError,
    ValidationError,
)
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from volspec import __version__
from volspec._confine import confined
from volspec._files import ensure_writable_caches
from volspec.errors import InputError, VolspecError, VolspecWarning, nearest, one_line, visible

app = App(
    name="volspec",
    help="Swap the light on a volume: cast once with spectral materials, relight for ever.\n\n"
    "With `--confined FOLDER`, any command opens only files below that folder, and no URLs: for "
    "scenes of others.",
    version=__version__,
    help_format="markdown",
    suppress_keyboard_interrupt=False,
)

# The exit code that a shell reports for a command killed by SIGPIPE.
_CLOSED_PIPE = 128 + 13
_HALF_LINE = 500  # characters kept at each end of a longer message

INCOMPLETE = 3
"""Exit code if outputs are written, but parts of a volume could not be read."""
Device = Annotated[
    str | None,
    Parameter(
        help="Part of an OpenCL device's name; or the address of a Dask cluster, `tcp://HOST:PORT` "
        "or `local:N`, for a volume larger than memory."
    ),
]
Json = Annotated[bool, Parameter(name="--json", negative="", help="Print figures as JSON.")]


def as_written(kind: Any, tokens: Sequence[Token]) -> Any:
    """Convert a number, a whole number, a `Literal`, or a number or a word, for cyclopts.

    Unlike cyclopts' own converter, it does not round, and rejects ``none``.
    """
    word = tokens[0].value
    parts, words = get_args(kind), []
    if float in parts:
        words = [arg for part in parts for arg in get_args(part)]
        if word in words:
            return word
        kind = float
    if kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            noun = "whole number" if kind is int else "number"
            other = "".join(f", or {name}" for name in words)
            raise ValueError(
                f"{word!r} is not a {noun}; {nearest(word, words)}give one{other}"
            ) from None
    choices = {str(choice): choice for choice in get_args(kind)}
    if word not in choices:
        guess = nearest(word, [name for name in get_args(kind) if isinstance(name, str)])
        raise ValueError(f"{word!r} is unknown; {guess}give one of {', '.join(choices)}")
    return choices[word]


class bar:
    """A progress bar on stderr, one line per step; hidden if ``quiet``, cleared after an error.

    ``left`` adds the remaining time, for long steps.
    """

    def __init__(self, quiet: bool = False, left: bool = False) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            *((TextColumn("left"), TimeRemainingColumn()) if left else ()),
            console=Terminal(stderr=True),
            disable=quiet,
        )
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> bar:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self._progress.stop()
        else:  # the message is printed alone
            self._progress.live.transient = True
            self._progress.live.stop()

    def __call__(self, step: str, fraction: float) -> None:
        self._progress.start()  # late, as an empty bar would print a blank line; idempotent
        if step not in self._tasks:
            self._tasks[step] = self._progress.add_task(step, total=1.0)
        self._progress.update(self._tasks[step], completed=fraction)

    def describe(self, step: str, text: str) -> None:
        """Replace the text of a step's line."""
        if step not in self._tasks:
            self(step, 0.0)
        self._progress.update(self._tasks[step], description=visible(text))

    def report(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(f"volspec: {one_line(text)}", soft_wrap=True)


class Terminal(Console):
    """Terminal that prints control characters and markup in names literally.

    With ``markup``, ``[red]`` in texts is a colour: for texts without names, or with escaped names.
    """

    def __init__(self, *, markup: bool = False, **options: Any) -> None:
        super().__init__(markup=markup, emoji=False, **options)

    def on_broken_pipe(self) -> None:
        """Leave the error to `main`; rich would exit with 1."""
        raise  # the BrokenPipeError that rich is handling

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterator[Segment]:
        """Return the segments to print."""
        for segment in super().render(renderable, options):
            lines = [visible(line) for line in segment.text.split("\n")]
            yield segment if segment.control else segment._replace(text="\n".join(lines))


def say(text: object) -> None:
    """Print one line literally and unwrapped, whatever names it has."""
    Terminal().print(visible(str(text)), highlight=False, soft_wrap=True)


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, singular or plural.

    >>> count_of(1, "light"), count_of(2, "light")
    ('1 light', '2 lights')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def print_json(data: dict[str, Any] | list[dict[str, Any]]) -> None:
    print(json.dumps(data, indent=2))


def print_table(title: str, table: Table, console: Console | None = None) -> None:
    """Print a table under its title, which stays on one line even above a narrow table."""
    console = console or Terminal()
    console.print(Text(visible(title), style="table.title"), soft_wrap=True)
    console.print(table)


def note(text: str) -> None:
    """Print a line to stderr, apart from the figures on stdout."""
    print(f"volspec: note: {one_line(text)}", file=sys.stderr)


def note_everyday(text: str) -> None:
    """Print the light that an everyday word means, such as LED."""
    from volspec.spectra.library import canonical_light

    name = canonical_light(text)
    if name is not None and name.casefold() != text.strip().casefold():
        note(f"{text} is {name}")


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
) -> None:
    if issubclass(category, VolspecWarning):
        print(f"volspec: warning: {one_line(message)}", file=sys.stderr)


def _print_what_can_be() -> None:
    """Replace characters that a stream's encoding lacks by ``?``."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and codecs.lookup(stream.encoding).name != "utf-8":
            stream.reconfigure(errors="replace")


def _arity_message(error: CycloptsError) -> str:
    """Return a message on a missing or extra argument; cyclopts would print a Python list."""
    command = " ".join(error.command_chain or ())
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        word = error.unused_tokens[0]
        hint = "; give each its own option" if "=" in word else ""
        return f"{command}: {_takes(command)}unexpected argument {word!r}{hint}"
    if not isinstance(error, MissingArgumentError) or error.argument is None:
        return ""
    names = error.argument.names
    if error.keyword is not None:
        return f"{command}: {error.keyword} has no value; give one{_example(command, names)}"
    return f"{command}: {' or '.join(names)} is missing{_example(command, names)}"


def _takes(command: str) -> str:
    """Return what a command takes without an option's name, such as "takes one VOLUME, "."""
    arguments = _command(command.split()).assemble_argument_collection()
    first = [argument.names[0] for argument in arguments]
    names = [name for name in first if not name.startswith(("-", "*"))]
    return f"takes one {' and one '.join(names)}, " if names else "takes options only, "


def _example(command: str, options: Sequence[str]) -> str:
    """Return an option's value in the examples of a command's help, such as ", as in -o a.png"."""
    if not options[0].startswith("-"):
        return ""
    names = "|".join(map(re.escape, options))
    match = re.search(rf"Example: .*?((?:{names}) (?!-)[^\s`]+)", _help(command.split()))
    return f", as in {match[1]}" if match else ""


def _help(words: Sequence[str]) -> str:
    """Return the docstring of a command."""
    command = _command(words)
    return command.default_command.__doc__ or "" if command.default_command else ""


def _command(words: Sequence[str]) -> App:
    command = app
    for word in words:
        command = command[word]
    return command


def _value_message(error: CoercionError | ValidationError) -> str:
    """Return a message on a bad value, without cyclopts' "Invalid value for"."""
    if isinstance(error, CoercionError) or error.argument is None:
        return one_line(error).removeprefix("Invalid value for ").rstrip(".")
    token = error.argument.tokens[0]
    return f"{token.keyword or error.argument.name}: {one_line(error.exception_message)}"


def _close_pipes() -> None:
    """Send further output of closed pipes to nowhere, at exit, too."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except BrokenPipeError:
            os.dup2(nowhere, stream.fileno())


def _message_of(error: Exception) -> str:
    """Return an error's message, with a remedy for the system's own errors."""
    if isinstance(error, VolspecError):
        return str(error)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}; check the path, its permissions and the disk"
    if isinstance(error, UnicodeEncodeError):
        return f"{error.object!r:.60} cannot be written as UTF-8; rename that file"
    return f"out of memory ({one_line(error)}); make the picture or the file smaller"


def _failure(message: str, code: int) -> SystemExit:
    """Print a message, cut in the middle to about 1000 characters: its ends are name and remedy."""
    line = one_line(message)
    if len(line) > 2 * _HALF_LINE:
        line = f"{line[:_HALF_LINE]} … {line[-_HALF_LINE:]}"
    print(f"volspec: {line}", file=sys.stderr)
    return SystemExit(code)


def main(arguments: list[str] | None = None) -> None:
    """Run the ``volspec`` command with the given arguments, by default the process's own."""
    code = 0
    try:
        _run(list(sys.argv[1:] if arguments is None else arguments))
    except SystemExit as stop:
        if arguments is not None or not isinstance(stop.code, int):
            raise
        code = stop.code
    if arguments is None:
        _exit(code)


def _exit(code: int) -> NoReturn:
    """End the process, even while background threads run.

    Python's own shutdown stops each thread at its next step, and if that step is inside a C++
    extension (reading a file, importing a module), the process aborts.
    """
    if any(thread.daemon for thread in threading.enumerate()):
        atexit._run_exitfuncs()
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with suppress(OSError):
                stream.flush()
        os._exit(code)
    raise SystemExit(code)


def _run(words: list[str]) -> None:
    debug = "--debug" in words
    _print_what_can_be()
    words = [word for word in words if word != "--debug"]
    folder = _confined_to(words)
    warnings.showwarning = _show_warning
    ensure_writable_caches()
    try:
        try:
            with nullcontext() if folder is None else confined(folder):
                app(words, console=Terminal(), exit_on_error=False, print_error=False)
        finally:
            print(end="", flush=True)  # now, as at exit it is too late to report a closed pipe
    except (CoercionError, ValidationError) as error:
        raise _failure(_value_message(error), 1) from error
    except CycloptsError as error:
        # Cyclopts cuts a long list of commands short: "info, ...".
        message = _arity_message(error) or one_line(error).replace(", ...", " and more").rstrip(".")
        message = message[:1].lower() + message[1:]
        command = " ".join(("volspec", *(error.command_chain or ())))
        mark = "" if message.endswith("?") else ";"
        raise _failure(f"{message}{mark} see {command} --help", 2) from error
    except BrokenPipeError as error:
        _close_pipes()
        raise SystemExit(_CLOSED_PIPE) from error
    except (VolspecError, OSError, UnicodeEncodeError, MemoryError) as error:
        if debug:
            raise
        raise _failure(_message_of(error), 1) from error
    except KeyboardInterrupt:
        raise _failure("interrupted; no output is half-written", 130) from None


def _confined_to(words: list[str]) -> str | None:
    """Take ``--confined FOLDER`` out of a command's words; return the folder, None without one."""
    for number, word in enumerate(words):
        name, mark, folder = word.partition("=")
        if name != "--confined":
            continue
        taken = words[number : number + (1 if mark else 2)]
        del words[number : number + len(taken)]
        if not (folder := folder if mark else "".join(taken[1:])):
            raise _failure("--confined has no value; give the folder of the scenes", 2)
        return folder
    return None


def show_names(names: Sequence[str], search: str, kind: str, as_json: bool) -> None:
    """Print the names of a kind (``kind``) that contain a text in any case, one per line.

    Raises `InputError` if no name contains it.
    """
    matches = [name for name in names if search.casefold() in name.casefold()]
    if not matches:
        raise InputError(
            f"--list {search!r}: no {kind} has it in its name; {nearest(search, names)}"
            "leave it out to see all",
            code="unknown",
        )
    if as_json:
        print_json([{"name": name} for name in matches])
        return
    for name in matches:
        say(name)


Row = dict[str, Any]


def show_rows(title: str, rows: list[Row], as_json: bool) -> None:
    """Print rows as JSON or as a table; columns with one value for all rows move to the title."""
    from rich.table import Table

    if as_json:
        print_json([{k: _finite(v) for k, v in row.items()} for row in rows])
        return
    names = list(dict.fromkeys(name for row in rows for name in row))
    if "L_A" in names:
        title += f", L_A {rows[0]['L_A']:.4g} cd/m², Y_b {rows[0]['Y_b']:g}"
    all_defined = all(row["defined"] for row in rows if "defined" in row)
    hidden = {"L_A", "Y_b", *(["defined"] if all_defined else [])}
    alike = [name for name in names[:4] if "model" in names and len({r[name] for r in rows}) == 1]
    for name in alike:
        title += f", {name} {rows[0][name]}"
        hidden.add(name)
    table = Table(box=None, pad_edge=False)
    columns = [name for name in names if name not in hidden]
    for name in columns:
        words = name in ("model", "paint")
        # A long name is folded, so that digits of other columns are not cut.
        table.add_column(name, justify="left" if words else "right", no_wrap=name != "paint")
    for row in rows:
        table.add_row(*(_cell(row.get(name, "")) for name in columns))
    # On a narrow screen lines wrap, but digits are never cut.
    print_table(title, table, Terminal(width=max(Terminal().width, 110)))


def warn_undefined(rows: Mapping[str, list[Row]]) -> None:
    """Print a note with the number of colours that are not ``defined``, by model."""
    missed = {name: sum(not row["defined"] for row in group) for name, group in rows.items()}
    missed = {name: count for name, count in missed.items() if count}
    if not missed:
        return
    (first, count), *further = missed.items()
    total = len(rows[first])
    text = f"{count} of {total} colour{'s' * (total > 1)} lie{'s' * (count == 1)} outside "
    text += f"the domain of {first}"
    text += "".join(f", {more} outside that of {name}" for name, more in further)
    note(f"{text}; marked defined = false")


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _finite(value: Any) -> Any:
    """Replace non-finite numbers, which JSON lacks, by None."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
