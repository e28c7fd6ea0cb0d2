"""Dask's scheduler and workers as separate processes on this machine."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tests.support.processes import signals_by_default


def free_port() -> int:
    """Return an unused port."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@contextmanager
def dask(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run `dask WORDS` as a separate process, which is killed in the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=signals_by_default,  # noqa: PLW1509 - no thread holds a lock that it needs
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def scheduler(port: int) -> tuple[str, ...]:
    """Return the arguments that start a scheduler."""
    return ("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")


def worker(port: int) -> tuple[str, ...]:
    """Return the arguments that start a worker; it ends a minute after its scheduler."""
    address = f"tcp://127.0.0.1:{port}"
    return (
        "worker",
        address,
        "--no-nanny",
        "--nthreads",
        "1",
        "--no-dashboard",
        "--death-timeout",
        "60",
    )
