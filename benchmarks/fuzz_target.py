"""A reader under fuzzing.

fuzz_targets, fuzz_volumes -> [fuzz_target] -> fuzz, fuzz_child, tests/fuzz/test_fuzz.py
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from volspec.errors import VolspecError


@dataclass(frozen=True, slots=True)
class Target:
    """A reader under fuzzing.

    Parameters
    ----------
    read : callable
        Reads a path; raises one of ``allowed`` to refuse it.
    seeds : callable
        Returns valid files, as bytes.
    file : str
        Name of the mutated file, in a folder of its own; its suffix often selects the reader.
    companions : callable
        Returns the other files in that folder, as {name: bytes}.
    opens : str
        Argument of ``read``, relative to the folder: ``"."`` is the folder itself; by default the
        mutated file.
    tokens : tuple of bytes
        Words of the format, which mutations insert.
    most : int
        Largest input, bytes; up to 65,536.
    declared : callable
        Returns the memory that reading a file may need, given its bytes; more than twice that and
        200 MB is a finding.
    peak : callable
        Returns the peak bytes of another process for the last input.
    allowed : tuple of type
        Exceptions that are not findings.
    """

    read: Callable[[Path], object]
    seeds: Callable[[], Iterable[bytes]]
    file: str = "input"
    companions: Callable[[], Mapping[str, bytes]] = dict
    opens: str = ""
    tokens: tuple[bytes, ...] = ()
    most: int = 1 << 14
    declared: Callable[[bytes], int] = len
    peak: Callable[[], int] = lambda: 0
    allowed: tuple[type[BaseException], ...] = (VolspecError,)

    def lay_out(self, folder: Path) -> None:
        """Write the files next to the mutated one."""
        for name, data in self.companions().items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        (folder / self.file).parent.mkdir(parents=True, exist_ok=True)

    def run(self, folder: Path, data: bytes) -> BaseException | None:
        """Read bytes as the file; return what was raised."""
        file = folder / self.file
        file.write_bytes(data)
        try:
            self.read(folder / self.opens if self.opens else file)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit is also a finding
            return error
        return None

    def is_finding(self, error: BaseException | None) -> bool:
        """Return True if the reader must not raise that error."""
        return error is not None and not isinstance(error, self.allowed)
