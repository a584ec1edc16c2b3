"""A real JupyterLab on a free port, all of its files in one folder, and a browser before it."""

import json
import os
import secrets
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

from tests.support.browser import chromium
from tests.support.patience import PATIENCE_S, wait_until
from volspec import _cache

ROOT = Path(__file__).resolve().parents[2]
_NOTEBOOK = "cells.ipynb"
_SESSION = {"path": _NOTEBOOK, "name": _NOTEBOOK, "type": "notebook", "kernel": {"name": "python3"}}
_KERNEL = {"name": "python3", "display_name": "Python 3", "language": "python"}
_OPTIONS = (
    *("--no-browser", "--allow-root", "--ServerApp.ip=127.0.0.1", "--ServerApp.port_retries=0"),
    "--LabApp.expose_app_in_browser=True",
    # What looks on the network for news, and what no notebook needs.
    "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
    "--LabApp.extension_manager=readonly",
)
# Ends when the kernel is done. Keys would get lost before it is there, clicks while cells grow.
_RUN = """async ([number, seconds]) => {
    const { commands, restored, shell } = window.jupyterapp;
    const run = async () => {
        await restored;
        const { content, context, sessionContext } = shell.currentWidget;
        await context.ready;
        await sessionContext.ready;
        await sessionContext.session.kernel.info;
        content.activeCellIndex = number;
        await commands.execute('notebook:run-cell');
    };
    const late = new Promise((_, fail) => {
        setTimeout(() => fail(new Error(`cell ${number} does not end`)), 1000 * seconds);
    });
    await Promise.race([run(), late]);
}"""
_SERVER_EXTENSIONS = {"jupyterlab": True, "jupyter_lsp": False, "jupyter_server_terminals": False}
_NEWS = "@jupyterlab/apputils-extension:announcements"


@dataclass
class Lab:
    """A notebook in JupyterLab, its first cell run, the widget shown."""

    page: Any
    requests: list[str] = field(default_factory=list)

    @property
    def frame(self) -> Any:
        """The widget's page; the newer one while it takes another's place."""
        return self.page.frame_locator(".jp-OutputArea iframe >> nth=-1")

    def run(self, number: int) -> str:
        """Run a cell once, as its button does; what it printed."""
        self.page.evaluate(_RUN, [number, PATIENCE_S])
        cell = self.page.locator(".jp-Notebook .jp-CodeCell").nth(number)
        return "".join(cell.locator(".jp-OutputArea-output").all_text_contents())

    def until(self, selector: str, words: str) -> None:
        """Wait until an element of the widget's page has words, and is drawn so."""
        self.frame.locator(selector, has_text=words).wait_for(timeout=1000 * PATIENCE_S)
        frames = "() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))"
        self.frame.locator("html").evaluate(frames)

    def ready(self) -> None:
        self.frame.locator("html.ready").wait_for(state="attached", timeout=1000 * PATIENCE_S)


@contextmanager
def opened(folder: Path, cells: Sequence[str]) -> Iterator[Lab]:
    """A notebook of these cells in a folder, the first of them run."""
    cell = {"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": None}
    notebook = {
        "cells": [{**cell, "id": str(i), "source": text} for i, text in enumerate(cells)],
        "metadata": {"kernelspec": _KERNEL},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    (folder / _NOTEBOOK).write_text(json.dumps(notebook), encoding="utf-8")
    with _server(folder) as (address, token), chromium() as browser:
        # The kernel starts while JupyterLab loads.
        _asked(f"{address}/api/sessions", token, _SESSION)
        page = browser.new_page(viewport={"width": 1280, "height": 1000})
        lab = Lab(page)
        page.on("request", lambda request: lab.requests.append(request.url))
        page.goto(f"{address}/doc/tree/{_NOTEBOOK}?token={token}")
        page.wait_for_selector(".jp-Notebook .jp-CodeCell", timeout=1000 * PATIENCE_S)
        lab.run(0)
        lab.ready()
        yield lab


@contextmanager
def _server(folder: Path) -> Iterator[tuple[str, str]]:
    """JupyterLab's address and token."""
    token = secrets.token_hex(16)
    log = folder / "server.log"
    words = [
        *(sys.executable, "-m", "jupyterlab", *_OPTIONS, "--port=0"),
        *(f"--ServerApp.root_dir={folder}", f"--IdentityProvider.token={token}"),
        f"--ServerApp.jpserver_extensions={_SERVER_EXTENSIONS}",
    ]
    with log.open("wb") as said:
        environment = _environment(folder)
        server = subprocess.Popen(words, cwd=folder, env=environment, stdout=said, stderr=said)
        try:
            told = folder / "JUPYTER_RUNTIME_DIR" / f"jpserver-{server.pid}.json"
            yield _await(server, told, log), token
        finally:
            # JupyterLab ends its kernels before it goes.
            server.terminate()
            server.wait(PATIENCE_S)


def _environment(folder: Path) -> Mapping[str, str]:
    """Nothing of the user's is read or written; what this process has kept is kept there too."""
    names = ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR")
    more = ("JUPYTERLAB_SETTINGS_DIR", "JUPYTERLAB_WORKSPACES_DIR", "IPYTHONDIR")
    homes = {name: str(folder / name) for name in (*names, *more)}
    config = folder / "JUPYTER_CONFIG_DIR" / "labconfig"
    config.mkdir(parents=True)
    off = {"disabledExtensions": {_NEWS: True}}
    (config / "page_config.json").write_text(json.dumps(off), encoding="utf-8")
    caches = folder / "caches"
    caches.mkdir()
    (caches / "volspec").symlink_to(_cache.cache_folder())
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return os.environ | homes | {"XDG_CACHE_HOME": str(caches), "PYTHONPATH": path}


def _await(server: subprocess.Popen[bytes], told: Path, log: Path) -> str:
    def answers() -> str:
        try:
            address = f"http://127.0.0.1:{json.loads(told.read_text(encoding='utf-8'))['port']}"
            _asked(f"{address}/api")
        except (OSError, ValueError):
            assert server.poll() is None, log.read_text(encoding="utf-8")
            return ""
        return address

    return wait_until(answers, "no answer")


def _asked(address: str, token: str = "", body: Mapping[str, Any] | None = None) -> None:
    headers = {"Content-Type": "application/json", "Authorization": f"token {token}"}
    data = None if body is None else json.dumps(body).encode("utf-8")
    with urlopen(Request(address, data, headers), timeout=PATIENCE_S) as answer:
        answer.read()
