"""Serves one page to the browsers of this machine."""

from __future__ import annotations

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

from scenes.input_error import InputError

HOST = "localhost"  # no other machine can reach it
FREE_PORTS = range(7000, 8000)


class PageServer:
    """Serves the page at `url` until `close`, from a thread of its own.

    Args:
        page: the HTML text.
        port: where it listens; None for the first free one from 7000 on.

    Raises:
        InputError: the port is taken or not allowed.
    """

    def __init__(self, page: str, port: int | None = None) -> None:
        content = page.encode()

        class Handler(BaseHTTPRequestHandler):
            """Answers with the page, and with nothing else."""

            def do_GET(self) -> None:
                known = self.path.split("?")[0].split("#")[0] in ("/", "/index.html")
                body = content if known else b""
                self.send_response(200 if known else 404)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                if self.command == "GET":
                    self.wfile.write(body)

            do_HEAD = do_GET

            def log_message(self, format: str, *args: object) -> None:
                """Says nothing: standard error is for what the user must know."""

        self._server = _listen(Handler, port)
        self.url = f"http://{HOST}:{self._server.server_port}"
        Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Stops listening."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that goes away while it is answered is no error."""


def _listen(handler: type[BaseHTTPRequestHandler], port: int | None) -> _Server:
    reason: OSError | None = None
    for candidate in FREE_PORTS if port is None else (port,):
        try:
            return _Server((HOST, candidate), handler)
        except OSError as error:
            reason = error  # the last one is told
    where = f"port {port}" if port is not None else f"any port from {FREE_PORTS[0]} to {FREE_PORTS[-1]}"
    raise InputError(f"cannot open {HOST} at {where}: it is taken or not allowed ({reason})")
