"""GPU code shared by all stages: devices, contexts, sources, the shared prelude."""
