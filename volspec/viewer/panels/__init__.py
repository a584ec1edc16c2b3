"""The window's panels: functions of a state that draw it and return the state that is wanted.

``draw(state, desk)`` gives None where nothing was changed. No panel decides what reruns.
"""
