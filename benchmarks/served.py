"""Is a served page quick, and little sent to it? ``python -m benchmarks.served``.

The bundled engine, 512², by ``volspec serve`` in a process of its own, over loopback.
"""

from __future__ import annotations

import http.client
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

from benchmarks.measure import Figure, report
from volspec._gpu.sources import asset

# Views of a turn that are asked for one after the other, of which the first set the pace.
VIEWS, FIRST = 24, 8


def figures() -> Iterator[Figure]:
    """Yield the time to the first page, and bytes and round trips of coarse and whole views."""
    for name, file in (("scene", "data/scenes/engine.toml"), ("volume", "data/engine.nrrd")):
        started = time.perf_counter()
        with _served(str(asset(file))) as (connection, cookie):
            connection.request("GET", "/", headers={"Cookie": cookie})
            page = connection.getresponse().read()
            first_s = time.perf_counter() - started
            head = f"served/{name}"
            yield Figure(f"{head}, start to page", first_s, 15.0, at_most=True, unit="s")
            yield Figure(f"{head}, page", len(page) / 1e6, 0.5, at_most=True, unit="MB")
            for coarse, kind, most_mb, most_ms in (
                (1, "coarse", 0.2, 150.0),
                (0, "whole", 0.5, 600.0),
            ):
                sizes, times = [], []
                for i in range(VIEWS):
                    words = f"azimuth={10 * i}&elevation=20&distance=1&coarse={coarse}"
                    at = time.perf_counter()
                    connection.request(
                        "GET", f"/view?{words}&transfer=0&client=1", headers={"Cookie": cookie}
                    )
                    sizes.append(len(connection.getresponse().read()))
                    times.append(1e3 * (time.perf_counter() - at))
                size, ms = (statistics.median(each[FIRST:]) for each in (sizes, times))
                yield Figure(f"{head}, {kind} view", size / 1e6, most_mb, at_most=True, unit="MB")
                yield Figure(f"{head}, {kind} round trip", ms, most_ms, at_most=True, unit="ms")


@contextmanager
def _served(file: str) -> Iterator[tuple[http.client.HTTPConnection, str]]:
    """Serve a file; yield a connection and the cookie."""
    command = [sys.executable, "-m", "volspec", "serve", file, "--port", "0", "--size", "512x512"]
    with subprocess.Popen(
        command, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout is not None
        try:
            address = urlsplit(process.stdout.readline().split()[0])
            connection = http.client.HTTPConnection(address.hostname, address.port)
            connection.request("GET", f"/?{address.query}")
            answer = connection.getresponse()
            answer.read()
            yield connection, answer.headers["Set-Cookie"].partition(";")[0]
            connection.close()
        finally:
            process.send_signal(signal.SIGINT)


if __name__ == "__main__":
    print(report(list(figures())))
