"""Trial of packets of rays: the time and the picture of a small cast, in a process of its own."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import numpy as np

from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.raycast.gpu import VolumeCaster
from volspec.raycast.launch.packets import Packet
from volspec.raycast.spec import RaycastSpec
from volspec.spectra import DEFAULT_GRID, Spectrum
from volspec.transfer import TransferFunction
from volspec.volume import Volume, phantom

_RUNS = 7
# Runtimes round differently; a wrong picture differs by more.
_SAME = 1e-4


def measure(index: str, *names: str) -> Iterator[tuple[str, float]]:
    """Yield packets, as JSON, with the CPU time of a small cast, ms.

    Those that differ from the first one's picture are left out.
    """
    ball = Volume((255 * phantom.ball(96).values).astype(np.uint8))
    white = {"white": Spectrum(DEFAULT_GRID.wavelengths_nm, np.ones(DEFAULT_GRID.size))}
    basis = SpectralBasis.load("general-7")
    transfer = TransferFunction([(0, 0.0, "white"), (255, 0.05, "white")], white, basis)
    camera, spec = Camera.orbit(ball), RaycastSpec(ambient=1.0, diffuse=0.0)
    first = None
    for name in names:
        packet = Packet(**json.loads(name))
        caster = VolumeCaster(ball, device=index, packet=packet)
        table = caster.bake(transfer)
        channels = caster.cast(table, camera, (256, 256), spec).coefficients
        first = channels if first is None else first
        if np.abs(channels - first).max() > _SAME:
            continue
        times = []
        for _ in range(_RUNS):
            start = time.process_time()
            caster.cast(table, camera, (256, 256), spec)
            times.append(time.process_time() - start)
        yield name, 1e3 * min(times)
