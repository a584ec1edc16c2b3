"""Rays: cuts, steps, projections, depths, cameras."""

from __future__ import annotations

from dataclasses import replace

import matplotlib
import numpy as np
from numpy.typing import NDArray

import volspec as vs
from tools.gallery.studio import BASIS, STUDIO, Picture, cast, halved, materials, show


def cuts(engine: vs.Volume) -> dict[str, Picture]:
    """Cuts open the block: any of up to six planes, or a box of voxels. What is cut away casts
    no shadow either.
    """
    looks = materials(block="Vrhel/63 light green towel", inserts="PMC/Carrot")
    points = [(70, 0.0, "block"), (90, 0.7, "block"), (160, 0.7, "block"), (190, 0.9, "inserts")]
    transfer = vs.TransferFunction(points, looks, BASIS)
    pose = {"elevation_deg": 32, "zoom": 2, "up": (0, 0, -1)}
    left = vs.Camera.orbit(engine, azimuth_deg=120, target_mm=(132, 121, 43), **pose)
    right = vs.Camera.orbit(engine, azimuth_deg=148, target_mm=(128, 146, 79), **pose)
    plane = vs.ClipPlane(point_mm=(100, 128, 55), normal=(1, -0.4, 0))
    box = ((0, 255), (0, 255), (30, 109))
    return {
        "a clip plane": show(cast(engine, transfer, left, replace(STUDIO, clip_planes=(plane,)))),
        "a crop": show(cast(engine, transfer, right, replace(STUDIO, crop_voxels=box))),
    }


def preintegration(engine: vs.Volume) -> dict[str, Picture]:
    """Two thin shells in value, sampled once a voxel. A step jumps over a shell and leaves bands;
    jitter turns them into noise; integrating the transfer function between the step's two ends
    finds every shell.
    """
    looks = materials(shell="PMC/Smurf", inserts="copper")
    shell = [(60, 0, "shell"), (62, 0.5, "shell"), (66, 0.5, "shell"), (68, 0, "shell")]
    points = [*shell, (180, 0, "inserts"), (184, 0.95, "inserts")]
    transfer = vs.TransferFunction(points, looks, BASIS)
    pose = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}
    camera = vs.Camera.orbit(engine, **pose, zoom=4)
    coarse = replace(STUDIO, step_mm=1.0, jitter=0)
    ways = {
        "read once a step": coarse,
        "the same, jittered": replace(coarse, jitter=1),
        "integrated over the step": replace(coarse, preintegrated=True),
    }
    return {label: show(cast(engine, transfer, camera, spec)) for label, spec in ways.items()}


def projections(aneurism: vs.Volume, foot: vs.Volume) -> dict[str, Picture]:
    """The greatest value along a ray, and the mean, much as an X-ray would have it; the transfer
    function says how a value looks. The mean is over the ray's way inside the volume: where that
    is short, at the foot's cut, it gets bright.
    """
    looks = materials(
        low="Vrhel/71 swiss army knife plastic", high="PMC/Orange Yellow", film="PMC/White"
    )
    heat = [
        (40, 0.0, "low"),
        (120, 0.6, "low"),
        (220, 0.9, "high"),
        (255, 1.0, {"high": 0.6, "film": 0.4}),
    ]
    greatest = vs.TransferFunction(heat, looks, BASIS)
    mean = vs.TransferFunction([(4, 0.0, "film"), (64, 1.0, "film")], looks, BASIS)
    vessels = vs.Camera.orbit(
        aneurism,
        azimuth_deg=0,
        elevation_deg=10,
        up=(1, 0, 0),
        zoom=1.95,
        target_mm=(130, 128, 117),
    )
    pose = {"azimuth_deg": 75, "elevation_deg": 35, "up": (-1, 0, 0)}
    bones = vs.Camera.orbit(foot, **pose, zoom=1.48, target_mm=(148, 111, 138))
    plain = vs.RaycastSpec(ambient=1, diffuse=0)
    return {
        "maximum": show(cast(aneurism, greatest, vessels, replace(plain, mode="maximum"))),
        "average": show(cast(foot, mean, bones, replace(plain, mode="average"))),
    }


def depth(engine: vs.Volume) -> dict[str, Picture]:
    """Every cast leaves two depths: where the opacity first passes a threshold, and the mean
    depth of what is seen, which looks through the translucent block to the parts inside. Below,
    the same direction through a wide lens and without perspective.
    """
    looks = materials(block="steel", inserts="PMC/Carrot")
    points = [
        (70, 0.0, "block"),
        (90, 0.025, "block"),
        (160, 0.025, "block"),
        (190, 0.9, "inserts"),
    ]
    transfer = vs.TransferFunction(points, looks, BASIS)
    pose = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}
    wide = {"fov_deg": 50, "zoom": 1.9, "target_mm": (138, 152, 79)}
    flat = {"orthographic": True, "zoom": 1.66, "target_mm": (130, 127, 52)}
    image = cast(engine, transfer, vs.Camera.orbit(engine, **pose, **wide))
    other = cast(engine, transfer, vs.Camera.orbit(engine, **pose, **flat))
    return {
        "first hit": false_colour(image.first_mm),
        "expected depth": false_colour(image.depth_mm),
        "perspective, 50°": show(image, exposure=1.3),
        "orthographic": show(other, exposure=1.3),
    }


def false_colour(depth_mm: NDArray[np.float32]) -> Picture:
    """Near is bright; nothing is dark grey."""
    hit = np.isfinite(depth_mm)
    near, far = np.percentile(depth_mm[hit], (0.5, 99.5))
    share = ((far - np.where(hit, depth_mm, far)) / (far - near)).clip(0, 1)
    colours = matplotlib.colormaps["magma"](0.08 + 0.9 * share)[..., :3]
    return halved(np.where(hit[..., None], colours, 0.1))
