"""Server of one scene: its page relights in a browser, and asks for a cast when the camera moves.

    scene -> [serve] -> page, one coefficient image per view -> browser

The volume stays where it is. tornado is an extra; only `scene_server` itself needs it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from volspec._extras import require_extra

if TYPE_CHECKING:
    from volspec.export.serve.http import SceneServer

__all__ = ["scene_server"]

HOST, PORT = "127.0.0.1", 8765


def scene_server(host: str = HOST, port: int = PORT, *, insecure: bool = False) -> SceneServer:
    """Return a server that listens at an address, and as yet has no scene.

    Parameters
    ----------
    host : str
        Name or number of the machine's address; by default only this machine can connect.
    port : int
        0 to 65535; 0 is any that is free.
    insecure : bool
        Allow an address of other machines, though nothing is encrypted.

    Raises
    ------
    DeviceError
        If the extra ``serve`` is not installed.
    InputError
        If there is no such address, the port cannot be used, or other machines could connect.

    Examples
    --------
    >>> from volspec.export.serve import scene_server
    >>> server = scene_server(port=0)
    >>> server.address[:17], server.is_private
    ('http://127.0.0.1:', True)
    >>> server.close()
    """
    require_extra("serve", "serve")
    from volspec.export.serve.http import SceneServer

    return SceneServer(host, port, insecure)
