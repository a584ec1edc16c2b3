"""Read and written: scenes, sessions, scripts, screenshots, the clipboard; and who asks for it."""
