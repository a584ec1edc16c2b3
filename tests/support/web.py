"""A web server of a folder that answers requests for parts of files, as object stores do."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path


@contextmanager
def served(folder: Path, *, ranges: bool = True) -> Iterator[tuple[str, list[str]]]:
    """Serve a folder, in parts or not; yield its address, and the paths that are asked for."""
    asked: list[str] = []
    with _Server(("127.0.0.1", 0), partial(_Files, folder, asked, ranges)) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}", asked
        finally:
            # Connections that stay open are answered, too, as those of a server in trouble.
            asked.append(_GONE)
            server.shutdown()
            thread.join()


_GONE = "gone"


class _Server(ThreadingHTTPServer):
    # On a busy machine many connections wait at once.
    request_queue_size = 128


class _Files(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def __init__(self, folder: Path, asked: list[str], ranges: bool, *given: object) -> None:
        self.folder, self.asked, self.ranges = folder, asked, ranges
        super().__init__(*given)

    def do_GET(self) -> None:
        if self.asked[-1:] == [_GONE]:
            self.send_error(503)
            return
        self.asked.append(self.path)
        file = self.folder / self.path.lstrip("/")
        data = file.read_bytes() if file.is_file() else b""
        status, size = (200 if file.is_file() else 404), len(data)
        if self.ranges and status == 200 and (asked := self.headers.get("Range")):
            first, _, last = asked.removeprefix("bytes=").partition("-")
            start = int(first) if first else size - int(last)
            end = min(int(last) + 1, size) if first and last else size
            data, status = data[start:end], 206
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Accept-Ranges", "bytes" if self.ranges else "none")
        if status == 206:
            self.send_header("Content-Range", f"bytes {start}-{end - 1}/{size}")
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(data)

    do_HEAD = do_GET

    def log_message(self, *_: object) -> None:
        """Print nothing."""
