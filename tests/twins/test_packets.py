"""Packets of rays: the same picture in each, and the choice of the fastest that works."""

import numpy as np
import pytest

from tests.support.raycasts import carries_16_rays
from volspec import _cache
from volspec._gpu import device_list as devices
from volspec._gpu.device_list import DeviceInfo
from volspec.camera import Camera
from volspec.large import Raycaster
from volspec.raycast import RaycastSpec
from volspec.raycast.launch import packets
from volspec.raycast.launch.packets import SAFE, Packet, choose_packet
from volspec.volume import Volume

TRIAL = packets._try  # as it is before any test replaces it
WIDE, WIDE_SINGLE = Packet(16), Packet(16, single_loads=True)
NARROW_SINGLE = Packet(8, single_loads=True)
# As in test_raycast.py.
TOLERANCE = 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dtype", "spec"),
    [
        ("uint8", RaycastSpec(ambient=1.0, diffuse=0.0, adaptive=0.02)),
        ("int16", RaycastSpec(specular=0.3)),
    ],
    ids=["adaptive", "shaded"],
)
def test_pictures_are_alike_in_all_packets(half_engine, three_channels, dtype, spec):
    volume = Volume(half_engine.values.astype(dtype), spacing_mm=half_engine.spacing_mm)
    camera, known = Camera.orbit(volume), [NARROW_SINGLE]
    if carries_16_rays():
        known += [WIDE, WIDE_SINGLE]
    first, *rest = (
        Raycaster(volume, packet=packet).cast(three_channels, camera, (96, 96), spec)
        for packet in (SAFE, *known)
    )
    assert first.alpha.max() > 0.5
    for packet, picture in zip(known, rest, strict=True):
        for ours, theirs in zip(picture[:2], first[:2], strict=True):
            assert np.abs(ours - theirs).max() < TOLERANCE, packet


def device(width: int, is_cpu: bool = True) -> DeviceInfo:
    return DeviceInfo("a device", "a platform", "3.0", "1.2", is_cpu, 8, 2**34, 2**32, width)


@pytest.mark.parametrize(
    ("width", "times", "chosen"),
    [
        (16, {SAFE: 20.0, WIDE: 12.0, WIDE_SINGLE: 11.9}, WIDE),  # no gain worth it
        (16, {SAFE: 20.0, WIDE: 15.0, WIDE_SINGLE: 11.0}, WIDE_SINGLE),
        (16, {SAFE: 20.0, WIDE: 25.0, WIDE_SINGLE: 24.0}, SAFE),
        (16, {SAFE: 20.0}, SAFE),  # the compiler ended the process
        (16, {}, SAFE),
        (8, {SAFE: 20.0, NARROW_SINGLE: 14.0}, NARROW_SINGLE),
    ],
)
def test_the_fastest_that_works_is_chosen_once(monkeypatch, tmp_path, width, times, chosen):
    tries: list[list[Packet]] = []

    def measured(index: int, known: list[Packet]) -> dict[Packet, float]:
        tries.append(known)
        return times

    monkeypatch.setattr(packets, "devices", lambda: [device(width)])
    monkeypatch.setattr(packets, "_try", measured)
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    assert choose_packet(0) == chosen == choose_packet(0)
    assert len(tries) == 1 and set(times) <= set(tries[0])
    (tmp_path / "packets.json").write_text('{"a": [')
    assert choose_packet(0) == chosen and len(tries) == 2


def test_a_gpu_marches_single_rays(monkeypatch):
    monkeypatch.setattr(packets, "devices", lambda: [device(1, is_cpu=False)])
    assert choose_packet(0) == Packet(1)


def test_a_device_that_cannot_be_tried_gets_what_all_compile(monkeypatch, tmp_path):
    """The child fails, as its list of devices is shorter."""
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    found = devices.devices()
    monkeypatch.setattr(packets, "_try", TRIAL)
    monkeypatch.setattr(packets, "devices", lambda: [*found, device(16)])
    assert choose_packet(len(found)) == SAFE
