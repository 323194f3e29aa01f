"""S3 server on loopback for tests: moto's, in a separate process."""

import contextlib
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.clusters import wait_until

KEYS = {
    "AWS_ALLOW_HTTP": "true",
    "AWS_ACCESS_KEY_ID": "test",
    "AWS_REGION": "us-east-1",
    "AWS_SECRET_ACCESS_KEY": "test",
}
"""Environment of a user of the server, in addition to its address in AWS_ENDPOINT_URL."""

SERVER = """
import functools, logging, sys
from moto.moto_server.werkzeug_app import DomainDispatcherApplication as Application
from moto.server import main
# Finding the service of a host and printing a line for every request would take longer than the request itself.
Application.get_backend_for_host = functools.cache(Application.get_backend_for_host)
logging.getLogger("werkzeug").setLevel(logging.ERROR)
main(sys.argv[1:])
"""


@contextlib.contextmanager
def s3_server(folder: Path) -> Iterator[str]:
    """Give the address of a server that runs until the end; skips the test where moto or obstore is not installed."""
    pytest.importorskip("obstore", reason="the extra 'cloud' is not installed")
    pytest.importorskip("moto.server", reason="moto's server, the S3 server of these tests, is not installed")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with (folder / "server.log").open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-c", SERVER, "-H", "127.0.0.1", "-p", str(port)], stdout=out, stderr=out
        )
    address = f"http://127.0.0.1:{port}"
    try:
        wait_until(lambda: _answers(address))
        yield address
    finally:
        process.kill()
        process.wait()


def make_bucket(server: str, name: str) -> str:
    """Make an empty bucket and give its address."""
    urllib.request.urlopen(urllib.request.Request(f"{server}/{name}", method="PUT")).close()
    return f"s3://{name}"


def _answers(address: str) -> bool:
    try:
        urllib.request.urlopen(address, timeout=1.0).close()
    except (urllib.error.URLError, OSError):
        return False
    return True
