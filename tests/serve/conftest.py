"""A ball that is served in a thread of its own, and a client that speaks plain HTTP."""

import http.client
import json
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from tests.support.patience import PATIENCE_S
from tests.support.scenes import scene_text
from volspec.export.serve import scene_server
from volspec.scene import Scene
from volspec.volume import phantom

MORE = """
basis = { name = "general-5" }
camera = { azimuth_deg = 20, elevation_deg = 10 }
annotation = [{ text = "here & there", points_mm = [[8, 8, 8]] }]
output = { width = 42, height = 30 }
"""
POINTS = [(0.2, 0.0, "gold"), (0.6, 0.5, "gold")]
SCENE = MORE + scene_text({"gold": "gold"}, POINTS, lights={"day": "D65", "lamp": "A"})


@dataclass
class Answer:
    status: int
    headers: http.client.HTTPMessage
    body: bytes

    @property
    def line(self) -> str:
        """The body, which is one line of text."""
        assert self.body.endswith(b"\n") and self.body.count(b"\n") == 1
        assert self.headers["Content-Type"].startswith("text/plain")
        return self.body.decode()

    def view(self) -> tuple[dict[str, Any], bytes]:
        """Numbers and channels of a view's message."""
        (length,) = struct.unpack_from(">I", self.body)
        return json.loads(self.body[4 : 4 + length]), self.body[4 + length :]


@dataclass
class Client:
    """A browser without a screen."""

    server: Any
    cookie: str = ""

    def get(self, path: str, method: str = "GET", **headers: str) -> Answer:
        """Ask for a path; underscores in names of headers are hyphens."""
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        if self.cookie:
            given.setdefault("Cookie", self.cookie)
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=PATIENCE_S)
        with closing(connection):
            connection.putrequest(method, path, skip_host="Host" in given)
            for name, value in given.items():
                connection.putheader(name, value)
            connection.endheaders()
            answer = connection.getresponse()
            return Answer(answer.status, answer.headers, answer.read())

    @property
    def token(self) -> str:
        return urlsplit(self.server.address).query

    def enter(self) -> Answer:
        """Open the printed address, and keep its cookie."""
        answer = self.get(f"/?{self.token}")
        self.cookie = answer.headers["Set-Cookie"].partition(";")[0]
        return answer

    def view(self, **words: object) -> Answer:
        given = {"azimuth": 20, "elevation": 10, "distance": 1, "coarse": 0, "transfer": 0}
        given |= {"client": 1} | words
        return self.get("/view?" + "&".join(f"{key}={value}" for key, value in given.items()))


@contextmanager
def serving(scene: Scene, host: str = "127.0.0.1", **how: Any) -> Iterator[Any]:
    server = scene_server(host, 0, insecure=True)
    try:
        server.open(scene, **how)
    except BaseException:
        server.close()
        raise
    thread = Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


@contextmanager
def entered(
    scene: Scene, message: Callable[..., bytes] | None = None, **how: Any
) -> Iterator[Client]:
    """Serve a scene, its casts perhaps replaced, to a client with the cookie."""
    with serving(scene, **how) as server:
        if message is not None:
            server._queue._message = message
        client = Client(server)
        client.enter()
        yield client


@pytest.fixture(scope="session")
def ball_scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder: Path = tmp_path_factory.mktemp("served")
    np.save(folder / "ball.npy", phantom.ball(17).values.astype(np.float32))
    (folder / "ball.toml").write_text(SCENE, encoding="utf-8")
    return Scene.load(folder / "ball.toml")


@pytest.fixture(scope="module")
def server(ball_scene: Scene) -> Iterator[Any]:
    with serving(ball_scene) as made:
        yield made


@pytest.fixture
def client(server: Any) -> Client:
    made = Client(server)
    made.enter()
    return made
