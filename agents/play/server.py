"""The web server of the page: bound before anything else is done, silent, and clear about a port that is taken."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import socket
from collections.abc import Iterator

import viser

from evergym.errors import ConfigError

__all__ = ["check_address", "describe_address", "start_server", "stop_server"]


def check_address(host: str, port: int) -> None:
    """Check that a page can be served at an address.

    Raises:
        ConfigError: the port is taken or forbidden, or the address is not this machine's.
    """
    if not 0 <= port <= 65535:
        raise ConfigError(f"--port is {port}; it must be in 0..65535 (0: any free port).")
    try:
        _bind(host, port)
    except socket.gaierror:
        raise ConfigError(
            f"--host '{host}' is no address. Use 127.0.0.1, or 0.0.0.0 for all of this machine."
        ) from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise ConfigError(f"Port {port} of {host} is in use. Choose another: --port {_find_free(host)}") from None
        if error.errno == errno.EACCES:
            raise ConfigError(f"Port {port} of {host} needs more rights. Choose one above 1023: --port 8080") from None
        raise ConfigError(
            f"No page can be served at {host}:{port}: {os.strerror(error.errno or 0)}. Is --host this machine's?"
        ) from None


def start_server(host: str, port: int, label: str) -> viser.ViserServer:
    """Start the server of an empty page.

    Raises:
        ConfigError: as ``check_address``.
    """
    check_address(host, port)  # viser would try the next thousand ports instead, and tell nobody
    with _silence():
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(25, 113, 194))
    # Lamps only: reflections of a warehouse would cost a machine without a graphics card most of its time.
    server.scene.configure_environment_map(None)
    server.scene.configure_default_lights(enabled=False, cast_shadow=False)
    return server


def describe_address(server: viser.ViserServer, host: str) -> str:
    """Return the page's address as a browser on this machine takes it."""
    name = "localhost" if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host  # noqa: S104 (compared)
    return f"http://{name}:{server.get_port()}"


def stop_server(server: viser.ViserServer) -> None:
    """Stop the server and its threads."""
    with _silence():
        server.stop()


def _bind(host: str, port: int) -> int:
    """Bind a socket for a moment and return its port."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does
        probe.bind((host, port))
        probe.listen()  # two may bind with SO_REUSEADDR, but only one listens
        number: int = probe.getsockname()[1]
        return number


def _find_free(host: str) -> int:
    return _bind(host, 0)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Keep the server's own notices from the terminal, where the page's address is to stand alone."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
