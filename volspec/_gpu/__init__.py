"""GPU machinery that knows no stage: devices, contexts, sources, the shared prelude."""
