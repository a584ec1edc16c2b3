"""Outputs: frames, films, contact sheets, recipes for compositors, web pages, notebooks."""

from volspec.export.frames import read_frame_text, write_frame
from volspec.export.sheet import SheetColumn, contact_sheet

__all__ = ["SheetColumn", "contact_sheet", "read_frame_text", "write_frame"]
