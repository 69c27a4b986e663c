"""A real nginx before a real server, with the configuration of docs/how-to/serve.md."""

from __future__ import annotations

import os
import pwd
import re
import shutil
import socket
import ssl
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import requests

from kg.serving.server import Limits
from tests.kg.serving.server.conftest import PATIENCE
from tests.waiting import listens

if TYPE_CHECKING:
    from tests.kg.serving.server.conftest import Served

NGINX = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
GUIDE = Path(__file__).parents[4] / "docs" / "how-to" / "serve.md"
NAME = "maps.example.org"

pytestmark = pytest.mark.skipif(
    NGINX is None or shutil.which("openssl") is None,
    reason="nginx or openssl is not installed: apt-get install nginx-light openssl",
)


def configuration(folder: Path, port: int, served: Served) -> str:
    """The documented file within the frame of Debian's, with other ports, and files in `folder`."""
    text = GUIDE.read_text(encoding="utf-8")
    found = re.search(r"^```nginx\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert found is not None
    inside = found[1].replace("127.0.0.1:8008", served.url.split("/")[2])
    inside = inside.replace("listen 443 ssl", f"listen 127.0.0.1:{port} ssl")
    inside = re.sub(r"/etc/ssl/(certs|private)/", f"{folder}/", inside)
    kinds = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    scratch = "".join(f"{kind}_temp_path {folder}/{kind}; " for kind in kinds)
    user = pwd.getpwuid(os.getuid()).pw_name
    return (
        f"user {user}; daemon off; pid {folder}/pid; error_log {folder}/errors;\n"
        f"events {{}}\nhttp {{ access_log off; {scratch}\n{inside} }}\n"
    )


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a certificate of its own authority."""
    folder = tmp_path_factory.mktemp("nginx")
    words = f"openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN={NAME} -addext"
    names = f"subjectAltName=DNS:{NAME},IP:127.0.0.1"
    files = ["-keyout", folder / f"{NAME}.key", "-out", folder / f"{NAME}.pem"]
    subprocess.run([*words.split(), names, *files], check=True, capture_output=True)
    return folder


@pytest.fixture
def proxied(serve: Callable[..., Served], certificate: Path, tmp_path: Path) -> Iterator[int]:
    """The port of a running nginx before a server that trusts it."""
    served = serve(
        public_hosts=(NAME,),
        trusted_proxies=("127.0.0.1",),
        limits=Limits(query_seconds=PATIENCE, client_feeds=1),
    )
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    for file in certificate.iterdir():
        shutil.copy(file, tmp_path)
    config = tmp_path / "nginx.conf"
    config.write_text(configuration(tmp_path, port, served))
    assert NGINX is not None
    words = [NGINX, "-e", str(tmp_path / "errors"), "-p", str(tmp_path), "-c", str(config)]
    with subprocess.Popen(words) as nginx:
        try:
            assert listens(port, nginx), (tmp_path / "errors").read_text()
            yield port
        finally:
            nginx.terminate()


def ask(port: int, path: str, method: str = "GET", **given: object) -> requests.Response:
    """The answer to a request by the proxy's name."""
    headers = {"Host": NAME, **given.pop("headers", {})}  # type: ignore[dict-item]
    url = f"https://127.0.0.1:{port}/{path}"
    given.setdefault("timeout", PATIENCE)
    return requests.request(method, url, headers=headers, verify=False, **given)  # type: ignore[arg-type]


@pytest.mark.filterwarnings("ignore:Unverified HTTPS request")
def test_the_documented_proxy_passes_on_what_the_server_needs_to_know(proxied: int) -> None:
    assert ask(proxied, "sparql", params={"query": "ASK {}"}).json()["boolean"] is True
    description = ask(proxied, ".well-known/void", headers={"Accept": "text/turtle"})
    assert f"<https://{NAME}/sparql>" in description.text
    own, other = {"Origin": f"https://{NAME}"}, {"Origin": "https://evil.example"}
    query = {"query": "ASK {}"}
    assert ask(proxied, "sparql", "POST", data=query, headers=own).status_code == 200
    assert ask(proxied, "sparql", "POST", data=query, headers=other).status_code == 403
    large = ask(proxied, "sparql", "POST", data={"query": "#" * 1_000_000 + "\nASK {}"})
    assert large.status_code in (200, 400)  # past the proxy
    assert ask(proxied, "sparql", "POST", data={"query": "#" * 9_000_000}).status_code == 413
    assert ask(proxied, "health", headers={"X": "x" * 13_000}).status_code == 400


@pytest.mark.filterwarnings("ignore:Unverified HTTPS request")
def test_the_documented_proxy_streams_feeds_and_names_each_client(proxied: int) -> None:
    def follow(address: str) -> requests.Response:
        session = requests.Session()
        session.mount("https://", _FromAddress(address))
        url = f"https://127.0.0.1:{proxied}/changes?since=0"
        return session.get(url, headers={"Host": NAME}, stream=True, verify=False, timeout=PATIENCE)

    with follow("127.0.0.2") as first, follow("127.0.0.3") as second:
        lines = [stream.iter_lines(1) for stream in (first, second)]  # closed with their iterators
        for part in lines:
            assert b"event: change" in part
        with follow("127.0.0.2") as third:  # each address has one feed
            assert third.status_code == 503


def test_half_requests_end_at_the_documented_proxy(proxied: int, certificate: Path) -> None:
    context = ssl.create_default_context(cafile=certificate / f"{NAME}.pem")
    with (
        socket.create_connection(("127.0.0.1", proxied), timeout=PATIENCE) as plain,
        context.wrap_socket(plain, server_hostname=NAME) as client,
    ):
        client.sendall(b"GET /health HTTP/1.1\r\nHost: " + NAME.encode())
        assert client.recv(100) == b""  # nginx hung up


class _FromAddress(requests.adapters.HTTPAdapter):
    def __init__(self, address: str) -> None:
        self._address = address
        super().__init__()

    def init_poolmanager(self, *arguments: object, **named: object) -> None:
        super().init_poolmanager(*arguments, source_address=(self._address, 0), **named)  # type: ignore[arg-type]
