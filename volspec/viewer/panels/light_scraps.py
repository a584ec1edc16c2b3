"""What the panel of lights keeps from frame to frame: texts under way, the pen, the open tab."""

from __future__ import annotations

from dataclasses import dataclass

from volspec.viewer.lighting import Rows


@dataclass(slots=True)
class LightScraps:
    """Nothing of it is part of a picture.

    Parameters
    ----------
    row : int
        The light that was chosen in the last frame.
    tab : str
        The tab that is open.
    to_tab : str
        The one that shall be; empty where nobody asked.
    part : int
        Of the chosen light's spectra, the one that is drawn.
    pen : (x, y), optional
        Where it was in the last frame, while it draws.
    top : float
        Power at the plot's upper edge, which stays while it draws.
    text, text_of
        A notation that is being typed, and for which light and part.
    naming : int
        The saved state that is being renamed; -1 is none.
    name : str
        What it shall be called.
    focus : bool
        Whether its field waits for the keyboard.
    complaint : str
        What is wrong with what was typed.
    complaint_of : ((light, part), rows)
        For which spectrum that was, and the lights as they were then.
    renaming : int
        The light that is being renamed; -1 is none.
    """

    row: int = 0
    tab: str = ""
    to_tab: str = ""
    part: int = 0
    pen: tuple[float, float] | None = None
    top: float = 1.0
    text: str = ""
    text_of: tuple[str, int] = ("", 0)
    naming: int = -1
    name: str = ""
    focus: bool = False
    complaint: str = ""
    complaint_of: tuple[tuple[int, int], Rows] = ((0, 0), ())
    renaming: int = -1

    def rename(self, index: int, rows: Rows) -> None:
        """Begin to rename a light."""
        self.renaming, self.name, self.focus = index, rows[index].name, True
        self.naming, self.row = -1, -1  # a name at a time; the row is scrolled to

    def complain(self, error: Exception, place: tuple[int, int], rows: Rows) -> None:
        """A notation, of a light's part, was no light."""
        self.complaint, self.complaint_of = " ".join(str(error).split()), (place, rows)

    def complaint_at(self, place: tuple[int, int], rows: Rows) -> str:
        """What stands under a part's field; gone once anything else of the lights is edited."""
        about, then = self.complaint_of
        return self.complaint if about == place and then is rows else ""
