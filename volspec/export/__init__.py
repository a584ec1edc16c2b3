"""Outputs: frames, films, contact sheets, recipes for compositors, web pages, and notebooks."""

from volspec.export.contact_sheet import SheetColumn, contact_sheet
from volspec.export.frames import read_frame_text, write_frame

__all__ = ["SheetColumn", "contact_sheet", "read_frame_text", "write_frame"]
