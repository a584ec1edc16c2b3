"""Drawing and input: imgui and glfw. Panels are functions ``draw(state, ui) -> state``."""
