"""Program and Python without start-up time: forks of one process that has loaded all modules.

A page of the documentation calls the program ten times, or runs as many blocks of Python; by itself each call spends
seconds on imports and on loading compiled kernels. What runs is the program's own ``main``, or the text after ``-c``,
with the caller's arguments, folder, environment and streams.
"""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

CLIENT = """#!{python} -IS
import json, os, socket, sys
if {name!r} == "python" and sys.argv[1] != "-c":
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    call = json.dumps([{name!r}, sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [len(call).to_bytes(8, "big")], [0, 1, 2])
    server.sendall(call)
    status = server.recv(1)
sys.exit(status[0] if status else "the program ended without a status")
"""

UNDRAWN = "GLIDERHPC_TESTS_UNDRAWN"
"""Variable of a caller's environment: not empty where its figures are to be made but not drawn."""


@contextlib.contextmanager
def forked_program(folder: Path) -> Iterator[Path]:
    """Run the process that is forked; gives the folder of a ``gliderhpc`` and a ``python`` that call it."""
    address, commands = folder / "program.socket", folder / "bin"
    commands.mkdir()
    for name in ("gliderhpc", "python"):
        client = commands / name
        client.write_text(CLIENT.format(python=sys.executable, address=str(address), name=name), "utf-8")
        client.chmod(0o755)
    source = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": source, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen([sys.executable, __file__, str(address)], env=environment) as server:
        try:
            while not address.exists():
                assert server.poll() is None, "the program cannot be imported"
                time.sleep(0.05)
            yield commands
        finally:
            server.terminate()


def _serve(address: str) -> None:
    """Fork for every call, once all that a call might need is loaded."""
    from benchmarks.preload import preload

    preload(kernels=True)
    # A command starts one worker process, not one for each core: each imports all again, and the tests use every core.
    os.sched_getaffinity = lambda _: {0}
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with socket.socket(socket.AF_UNIX) as listening:
        # Clients wait for the name: it must not be there before they can connect.
        listening.bind(f"{address}.new")
        listening.listen()
        Path(f"{address}.new").rename(address)
        while True:
            caller, _ = listening.accept()
            if os.fork() == 0:
                listening.close()
                _answer(caller)
            caller.close()


def _answer(caller: socket.socket) -> None:
    """Run the program, or a text of Python, as its caller would have, and end."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    size, streams, _, _ = socket.recv_fds(caller, 8, 3)
    with caller.makefile("rb") as call:
        name, arguments, folder, environment = json.loads(call.read(int.from_bytes(size, "big")))
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    if os.environ.get(UNDRAWN):
        _leave_undrawn()
    status = 1
    try:
        if name == "python":
            _, text = arguments
            sys.path.insert(0, "")
            exec(compile(text, "<string>", "exec"), {"__name__": "__main__"})
            status = 0
        else:
            from gliderhpc.cli.main import main

            main(arguments)
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:  # noqa: BLE001 - a fork must never go on as the process it came from
        sys.excepthook(*sys.exc_info())
    sys.stdout.flush()
    sys.stderr.flush()
    caller.sendall(bytes([status]))
    os._exit(status)


def _leave_undrawn() -> None:
    """Make figures without drawing them: the tests of each draw theirs."""
    from gliderhpc.findings import drawing

    drawing._png, drawing._svg = (lambda _: b"png"), (lambda _: b"svg")


if __name__ == "__main__":
    _serve(sys.argv[1])
