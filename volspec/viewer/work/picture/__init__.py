"""From a state to what is on the screen: casts and relit pictures, made beside the window."""
