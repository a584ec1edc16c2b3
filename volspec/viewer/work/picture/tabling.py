"""Tables of models that no shader draws, worked out beside the window.

    lights, viewing -> pictures -> [tabling] -> HostTables -> pictures

What is on the screen stays meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from volspec.errors import TableCancelled, VolspecError, one_line
from volspec.relight.tables import HostTables, TableKey
from volspec.viewer.work.latest import LatestWorker

# A light that is still for so long is one that somebody wants to see: there are seconds to lose.
REST_S = 0.1


class TableWorker(LatestWorker[tuple[TableKey, ...], str]):
    """Works tables out in a thread of its own, and gives what was wrong with them; mostly ``""``.

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    tables : HostTables
        Where they are put.
    """

    def __init__(self, wake: Callable[[], object], tables: HostTables) -> None:
        super().__init__(wake, "volspec-tables")
        self._tables = tables

    def _answers(self, job: tuple[TableKey, ...]) -> Iterator[str]:
        if not self._rests(REST_S):
            return
        try:
            for key in job:
                self._tables.texels(key, self._superseded)
        except TableCancelled:
            return
        except MemoryError:
            yield "no memory for the table"
        except VolspecError as error:
            yield one_line(error)
        else:
            yield ""
