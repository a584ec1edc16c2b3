"""Refusals of the server: token, cookie, names, paths, methods, parameters, ports."""

import asyncio
import re
import socket
import subprocess
import sys
from pathlib import Path
from threading import Thread

import pytest

from tests.serve.conftest import Client, serving
from tests.support.commands import call
from tests.support.errors import raises
from tests.support.patience import PATIENCE_S
from volspec.errors import DeviceError, InputError
from volspec.export.page import page_policy
from volspec.export.serve import scene_server


def test_the_token_buys_a_cookie_for_the_clean_address(server):
    client = Client(server)
    answer = client.enter()
    assert (answer.status, answer.headers["Location"], answer.body) == (303, "./", b"")
    assert client.token.partition("=")[2] not in answer.headers["Set-Cookie"]
    attributes = {part.strip() for part in answer.headers["Set-Cookie"].split(";")[1:]}
    assert attributes == {"HttpOnly", "SameSite=Strict"}
    page = client.get("/")
    assert page.status == 200 and b"<title>Relightable picture</title>" in page.body
    assert client.token.partition("=")[2] not in page.body.decode()


def test_a_token_is_used_up_by_the_first_browser(server):
    first, second, used = Client(server), Client(server), Client(server).token
    assert first.get(f"/?{used}", "HEAD").status == 403
    assert first.enter().status == 303
    assert second.get(f"/?{used}").status == 403 and second.token != used
    again = first.get(f"/?{used}")
    assert (again.status, again.headers["Set-Cookie"]) == (303, None)
    assert second.enter().status == 303 and second.get("/").status == 200


@pytest.mark.parametrize(
    ("path", "cookie"),
    [
        *((path, "") for path in ("/", "/view?azimuth=1", "/nothing", "/view?{token}")),
        *(
            (f"/?{query}", "")
            for query in ("token=", "token=wrong", "token=%ff%fe", "{token}&token=wrong")
        ),
        *(("/", f"volspec-{{port}}={value}") for value in ("wrong", "", '"\\377ü')),
    ],
)
def test_nothing_is_answered_without_the_secret(server, path, cookie):
    client = Client(server, cookie.format(port=server.port))
    answer = client.get(path.format(token=client.token))
    assert answer.status == 403 and answer.line and "Set-Cookie" not in answer.headers


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "", "[::1", "a@b:1"]
)
def test_other_names_are_refused_even_with_the_secret(client, host):
    host = host.format(port=client.server.port)
    for path in ("/", f"/?{client.token}", "/view"):
        assert client.get(path, Host=host).status in (400, 403)


@pytest.mark.parametrize(
    "host", ["localhost:{port}", "127.0.0.1:{port}", "[::1]:9000", "LOCALHOST"]
)
def test_own_names_are_answered_also_at_the_near_end_of_a_tunnel(client, host):
    assert client.get("/", Host=host.format(port=client.server.port)).status == 200


def test_all_addresses_take_any_name_but_still_the_token(ball_scene):
    with serving(ball_scene, host="0.0.0.0") as server:
        client = Client(server)
        assert not server.is_private and socket.gethostname() in server.address
        assert client.get("/", Host="hub.example").status == 403
        client.enter()
        assert client.get("/", Host="hub.example").status == 200


@pytest.mark.parametrize(
    "headers",
    [
        *({"Origin": origin} for origin in ("http://evil.example", "null", "http://127.0.0.1:1")),
        *({"Origin": origin} for origin in ("http://[", "//[::1", "http://[x]", "http://a]")),
        *({"Sec_Fetch_Site": site} for site in ("cross-site", "same-site")),
    ],
)
def test_other_sites_get_no_views(client, headers):
    words = "/view?azimuth=0&elevation=0&distance=1&coarse=1&transfer=0&client=1"
    answer = client.get(words, **headers)
    assert answer.status == 403 and answer.line
    own = f"http://127.0.0.1:{client.server.port}"
    assert client.get(words, Origin=own, Sec_Fetch_Site="same-origin").status == 200


@pytest.mark.parametrize(
    "path",
    [
        *("/../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/view/../../etc/passwd", "/etc/passwd"),
        *("//evil.example/", "//evil.example/?{token}", "http://evil.example/", "/\\..\\windows"),
        *("/view/", "/view%00", "/favicon.ico", "/index.html", "/page.html?azimuth=1", "*"),
    ],
)
def test_there_are_no_other_paths(client, path):
    answer = client.get(path.format(token=client.token), Host="localhost")
    assert (answer.status, answer.body.count(b"\n")) == (404, 1)
    assert "Location" not in answer.headers


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
@pytest.mark.parametrize("path", ["/", "/view", "/other"])
def test_only_reading_is_allowed(client, method, path):
    answer = client.get(path, method)
    assert (answer.status, answer.headers["Allow"]) == (405, "GET, HEAD")


def test_heads_have_no_body_and_cast_nothing(client):
    page = client.get("/", "HEAD")
    assert (page.status, page.body) == (200, b"") and int(page.headers["Content-Length"]) > 1000
    assert client.get("/view?azimuth=1", "HEAD").status == 405


def test_every_answer_forbids_what_it_does_not_need(client):
    page, policy = client.get("/"), page_policy(served=True)
    assert page.headers["Content-Security-Policy"] == f"{policy}; frame-ancestors 'none'"
    assert "connect-src 'self'" in policy and "connect-src" not in page_policy()
    given = {
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
    }
    for answer in (page, client.view(), client.get("/x"), client.get("/", "PUT")):
        assert given.items() <= dict(answer.headers).items()
        assert "Server" not in answer.headers and "ETag" not in answer.headers


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ({"azimuth": "x"}, "azimuth is 'x'; give one number from -360 to 360"),
        ({"azimuth": "nan"}, "azimuth is 'nan'"),
        ({"azimuth": "1e999"}, "azimuth is '1e999'"),
        ({"elevation": 91}, "elevation is '91'; give one number from -90 to 90"),
        ({"distance": 0}, "distance is '0'; give one number from 0.125 to 8"),
        ({"distance": ""}, "distance is ''"),
        ({"coarse": 2}, "coarse is '2'; give one whole number from 0 to 1"),
        ({"client": "1.5"}, "client is '1.5'"),
        ({"client": "9" * 5000}, "client is '999"),
        ({"file": "/etc/passwd"}, "no parameter 'file'"),
        ({"azimuth": "1&azimuth=2"}, "azimuth is '1, 2'"),
    ],
)
def test_wrong_parameters_are_named(client, words, named):
    answer = client.view(**words)
    assert answer.status == 400 and named in answer.line and len(answer.body) < 300


def test_it_answers_while_a_notebook_s_cell_waits(ball_scene):
    async def cell() -> None:
        made = scene_server("127.0.0.1", 0)
        made.open(ball_scene)

        def ask() -> None:
            statuses.append(Client(made).enter().status)
            made.stop()

        asks = iter([Thread(target=ask).start])  # a used token makes it ready again
        made.run(lambda: next(asks, int)())

    statuses: list[int] = []
    asyncio.run(cell())
    assert statuses == [303]


def test_the_extra_is_named_if_it_is_missing(monkeypatch):
    monkeypatch.delitem(sys.modules, "volspec.export.serve.http", raising=False)
    monkeypatch.setitem(sys.modules, "tornado", None)
    with raises(DeviceError, "unsupported") as refused:
        scene_server()
    assert 'pip install "volspec[serve]"' in str(refused.value)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "", "192.0.2.1", "2001:db8::1"])
def test_other_machines_connect_only_if_that_is_wanted(host):
    with raises(InputError, "conflict", "host") as refused:
        scene_server(host, 0)
    assert "--insecure" in refused.value.remedy
    assert call("serve", "no.toml", "--host", host) == 1


def test_the_command_prints_its_address_and_ends_by_an_interrupt(ball_scene, server, capsys):
    words = ["serve", str(ball_scene.path), "--size", "40x30"]
    assert call(*words, "--port", server.port) == 1
    assert f"--port is {server.port}" in capsys.readouterr().err
    command = [sys.executable, "-m", "volspec", *words, "--port", "0", "--host", "0.0.0.0"]
    command.append("--insecure")
    root = Path(__file__).resolve().parents[2]
    with subprocess.Popen(command, stdout=-1, stderr=-1, cwd=root, text=True) as process:
        assert re.match(r"http://[\w.-]+:\d+/\?token=[\w-]{32} ", process.stdout.readline())
        process.send_signal(2)
        assert process.wait(PATIENCE_S) == 0
        assert "Traceback" not in process.stderr.read()
