"""The lights: rows, parts, mixes, the dial, the pen, saved states and fades."""
