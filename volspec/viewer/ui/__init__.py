"""Drawing and input: imgui and glfw."""
