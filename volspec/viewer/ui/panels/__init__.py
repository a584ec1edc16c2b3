"""The window's panels: functions of a state that draw it and return the state that is wanted.

``draw(state, ui)`` gives None where nothing was changed. What a panel changes is an event or an
action; none decides what reruns. `widgets` has what all are drawn with.
"""
