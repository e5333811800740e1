"""A viewer that asks for a run's recording, takes the first of it, and never reads again: HTTP/2 by hand (RFC 9113)."""

from __future__ import annotations

import socket
import struct

_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
_DATA, _HEADERS, _SETTINGS, _WINDOW_UPDATE = 0x0, 0x1, 0x4, 0x8
_END_STREAM, _END_HEADERS = 0x1, 0x4
_PATH = "/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages"


def _frame(kind: int, flags: int, stream: int, body: bytes) -> bytes:
    return struct.pack(">I", len(body))[1:] + struct.pack(">BBI", kind, flags, stream) + body


def _literal(name: str, value: str) -> bytes:
    """A header that is never indexed, without Huffman coding (RFC 7541, 6.2.3); texts of up to 126 bytes."""
    return b"\x10" + bytes([len(name)]) + name.encode() + bytes([len(value)]) + value.encode()


class StalledViewer:
    """A subscription to a run's recording, until it is closed."""

    def __init__(self, port: int, timeout_s: float = 20.0) -> None:
        """Subscribe.

        Raises:
            OSError: nobody serves a recording there, or it sends nothing.
        """
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.settimeout(timeout_s)
        self._socket.connect(("127.0.0.1", port))
        headers = {
            ":method": "POST", ":scheme": "http", ":path": _PATH, ":authority": f"127.0.0.1:{port}", "te": "trailers",
            "content-type": "application/grpc",
        }  # fmt: skip
        block = b"".join(_literal(name, value) for name, value in headers.items())
        empty_message = b"\x00" * 5
        self._socket.sendall(
            _PREFACE
            + _frame(_SETTINGS, 0, 0, b"")
            + _frame(_WINDOW_UPDATE, 0, 0, struct.pack(">I", 1 << 24))
            + _frame(_HEADERS, _END_HEADERS, 1, block)
            + _frame(_DATA, _END_STREAM, 1, empty_message)
        )
        while (kind := self._next()) != _DATA:
            if kind not in (_HEADERS, _SETTINGS, _WINDOW_UPDATE):
                raise OSError(f"no recording: frame of kind {kind}")

    def _next(self) -> int:
        """Kind of the next frame, which is read whole."""
        head = self._exactly(9)
        self._exactly(int.from_bytes(head[:3], "big"))
        return head[3]

    def _exactly(self, count: int) -> bytes:
        taken = b""
        while len(taken) < count:
            piece = self._socket.recv(count - len(taken))
            if not piece:
                raise OSError("closed by the server")
            taken += piece
        return taken

    def close(self) -> None:
        self._socket.close()
