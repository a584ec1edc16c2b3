"""Choose what casts a picture: the device, or parts of a finer level, here or on a cluster."""

from __future__ import annotations

from typing import Any

from volspec.camera import Camera
from volspec.errors import RaycastError
from volspec.large.cluster import Cluster, is_cluster
from volspec.large.level_caster import LevelCaster, level_for
from volspec.raycast import RaycastSpec, VolumeCaster
from volspec.raycast.launch import Packet
from volspec.volume import Volume


class Raycaster(VolumeCaster):
    """A volume of any size on an OpenCL device; threads may share it and cast in turn.

    Parameters
    ----------
    volume : Volume, pyvista ImageData or array (Z, Y, X)
        As of `volspec.raycast`.
    lanes, packet, context
        See `VolumeCaster`.
    device : str, optional
        Part of a device's name; the first GPU, else the first CPU, if left out. Or the address of
        a Dask cluster, ``tcp://HOST:PORT`` or ``local:N`` for N workers on this machine, who cast
        the finer levels of a volume that is larger than memory.
    like : Raycaster, optional
        A caster of another volume, whose device, cluster, programs and packet this one shares; see
        `VolumeCaster`.

    Raises
    ------
    RaycastError, OpenCLError
        As `VolumeCaster`; if a cluster is given and the volume is in memory.
    """

    def __init__(
        self,
        volume: Volume | Any,
        *,
        device: str | None = None,
        lanes: int | None = None,
        packet: Packet | None = None,
        context: Any = None,
        like: Raycaster | None = None,
    ) -> None:
        volume = Volume.of(volume)
        cluster = like.cluster if like else None
        if device is not None and is_cluster(device):
            if volume.pyramid is None:
                raise RaycastError(
                    f"device {device}: a cluster casts what is larger than memory, which holds "
                    f"{volume.name}",
                    "leave it out, or give less memory than the voxels take, such as "
                    f"--memory {max(volume.values.nbytes // 2**21, 1)}MiB",
                    code="conflict",
                    given=device,
                )
            cluster, device = Cluster(device), None
        super().__init__(
            volume, device=device, lanes=lanes, packet=packet, context=context, like=like
        )
        self.cluster: Cluster | None = cluster
        self._levels: dict[int, LevelCaster] = {}

    def at(
        self, camera: Camera, size: tuple[int, int], spec: RaycastSpec
    ) -> Raycaster | LevelCaster:
        """Return the caster of the level of detail that a picture needs.

        It is this one, unless the volume is larger than memory; arguments are those of `cast`.
        """
        if self.volume.pyramid is None:
            return self
        self.volume.pyramid.retry()
        number = level_for(self.volume, camera, size, spec)
        if number == len(self.volume.pyramid.levels) - 1:
            return self
        if number not in self._levels:
            # One at a time: each has a light volume.
            cluster = self.cluster
            caster = LevelCaster(self, number) if cluster is None else cluster.caster(self, number)
            self._levels = {number: caster}
        return self._levels[number]
