"""The status socket: the newest snapshot as JSON lines to screens on this machine. Data flows out only.

One line is one :class:`~groundstation.snapshot.Snapshot` as a JSON object, keys as its fields; a number that is not
finite is ``null``. Fields may be added later: readers ignore the ones that they do not know.
"""

import asyncio
import math
import os
import stat
import typing
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Any, cast

import msgspec

from groundstation.broadcast import Latest
from groundstation.snapshot import Snapshot

CLIENTS_MAX = 16
"""More clients than this are turned away."""
BACKLOG_MAX_BYTES = 65536
"""A client that leaves more than this unread, beyond what the kernel holds for it, is dropped."""
LINE_MAX_BYTES = 1 << 20
"""No snapshot is longer; a reader that sees a longer line gives up."""


class StatusConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The socket that screens attach to."""

    path: str = ""
    """Path of the UNIX socket; empty means ``$XDG_RUNTIME_DIR/groundstation/VEHICLE.sock``, or else in /tmp."""
    rate_hz: Annotated[float, msgspec.Meta(ge=1.0, le=50.0)] = 5.0
    """Most snapshots a second to each client [1/s]; screens call it silence when none comes for 1.5 s."""


class StatusError(Exception):
    """The status socket can't be opened or read; the text says why and what to do."""


def directory() -> Path:
    """The folder of the status sockets of this user."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    return Path(runtime) / "groundstation" if runtime.startswith("/") else Path(f"/tmp/groundstation-{os.getuid()}")  # noqa: S108  # checked before use, see _own_directory


def socket_path(config: StatusConfig, vehicle: str) -> Path:
    """Where the status socket of ``vehicle`` is."""
    return Path(config.path) if config.path else directory() / f"{vehicle}.sock"


class StatusServer:
    """Serves the newest snapshot; encodes only while somebody is attached, at most ``rate_hz`` times a second."""

    def __init__(self, config: StatusConfig, vehicle: str, latest: Latest[Snapshot]) -> None:
        """Serve what ``latest`` holds, for the vehicle of that name."""
        self.path = socket_path(config, vehicle)
        self._period_s = 1.0 / config.rate_hz
        self._latest = latest
        self._clients: dict[_Client, int] = {}  # to the number of the snapshot that it got last
        self._attached = asyncio.Event()
        self._line = (0, b"")

    async def serve(self) -> None:
        """Serve until cancelled; attached clients then get the last snapshot, and the socket goes away.

        Raises:
            StatusError: another ground station serves there, or the path can't be used.
        """
        await self._claim()
        try:
            server = await asyncio.get_running_loop().create_unix_server(
                lambda: _Client(self), str(self.path), start_serving=False
            )
        except (OSError, ValueError) as error:
            raise StatusError(f"status socket {self.path}: {error}") from error
        try:
            self.path.chmod(0o600)  # nobody can connect before it: not listening yet
            await server.start_serving()
            while True:
                await self._attached.wait()
                self._publish()
                await asyncio.sleep(self._period_s)
        finally:
            self.path.unlink(missing_ok=True)
            server.close()
            self._publish()
            for client in list(self._clients):
                client.transport.close()

    def attach(self, client: "_Client") -> bool:
        """Take a new client, unless there are too many."""
        if len(self._clients) >= CLIENTS_MAX:
            return False
        self._clients[client] = 0
        self._attached.set()
        return True

    def detach(self, client: "_Client") -> None:
        """Forget a client that went away."""
        self._clients.pop(client, None)
        if not self._clients:
            self._attached.clear()

    def _publish(self) -> None:
        """Send the newest snapshot to every client that has not got it; drop those that do not read."""
        if not self._clients or self._latest.newest is None:
            return
        number, snapshot = self._latest.newest
        if number != self._line[0]:
            self._line = (number, msgspec.json.encode(snapshot) + b"\n")
        for client, last in list(self._clients.items()):
            if last == number:
                continue
            if client.transport.get_write_buffer_size() > BACKLOG_MAX_BYTES:
                client.transport.abort()
                continue
            self._clients[client] = number
            client.transport.write(self._line[1])

    async def _claim(self) -> None:
        """Make the path free for us: the folder is ours, and what a dead process left there is removed."""
        _own_directory(self.path.parent)
        try:
            mode = self.path.lstat().st_mode
        except FileNotFoundError:
            return
        if not stat.S_ISSOCK(mode):
            raise StatusError(f"status socket {self.path}: a file that is not a socket is there; move it away")
        try:
            _, writer = await asyncio.open_unix_connection(self.path)
        except ConnectionRefusedError:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise StatusError(f"status socket {self.path}: {error.strerror}") from error
        else:
            writer.close()
            raise StatusError(
                f"status socket {self.path}: another ground station is serving this vehicle; stop it, "
                "or give this one another vehicle.name or status.path"
            )


class _Client(asyncio.Protocol):
    """One attached reader. What it sends is never read."""

    transport: asyncio.Transport

    def __init__(self, server: StatusServer) -> None:
        self._server = server

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        if not self._server.attach(self):
            self.transport.abort()

    def data_received(self, data: bytes) -> None:
        del data
        self.transport.pause_reading()  # from now on it fills its own buffer; that it left shows at the next write

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self._server.detach(self)


def _own_directory(folder: Path) -> None:
    """Make ``folder`` where it is missing, for us alone.

    Raises:
        StatusError: it belongs to somebody else, or others may write to it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        info = folder.lstat()
    except OSError as error:
        raise StatusError(f"folder {folder} of the status socket: {error.strerror}") from error
    if not stat.S_ISDIR(info.st_mode) or info.st_uid != os.geteuid() or info.st_mode & 0o022:
        raise StatusError(
            f"folder {folder} of the status socket must be a folder that belongs to you and that nobody else "
            "may write to: another program could take the socket's place; set status.path"
        )


async def snapshots(path: Path) -> AsyncIterator[Snapshot]:
    """The snapshots served at ``path``, the newest where several wait; ends when the server closes.

    Raises:
        OSError: nobody serves there.
        StatusError: what is served there is not a snapshot of this version.
    """
    reader, writer = await asyncio.open_unix_connection(path)
    try:
        rest = b""
        while chunk := await reader.read(1 << 16):
            *lines, rest = (rest + chunk).split(b"\n")
            if lines:
                yield _decode(lines[-1], path)
            if len(rest) > LINE_MAX_BYTES:
                raise StatusError(f"no snapshots at {path}: a line is longer than {LINE_MAX_BYTES} bytes")
    finally:
        writer.close()


def _decode(line: bytes, path: Path) -> Snapshot:
    try:
        try:
            return msgspec.json.decode(line, type=Snapshot)
        except msgspec.ValidationError:
            return msgspec.convert(_with_nan(msgspec.json.decode(line)), Snapshot)
    except msgspec.DecodeError as error:
        raise StatusError(f"no snapshot of this version at {path}: {error}") from error


def _with_nan(line: Any) -> Any:
    """JSON has no NaN: wherever a null is not a None of the snapshot itself, it was a number that is not finite."""
    optional = {f.name for f in msgspec.structs.fields(Snapshot) if type(None) in typing.get_args(f.type)}
    if not isinstance(line, dict):
        return line
    return {key: value if value is None and key in optional else _nan(value) for key, value in line.items()}


def _nan(value: Any) -> Any:
    if value is None:
        return math.nan
    if isinstance(value, list):
        return [_nan(item) for item in value]
    if isinstance(value, dict):
        return {key: _nan(item) for key, item in value.items()}
    return value
