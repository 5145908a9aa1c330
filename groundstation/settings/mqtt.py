"""Where the broker is, how it is spoken to, and who may ask something by it."""

from typing import Annotated, Literal

import msgspec

from groundstation.config import CLIENT_LETTERS, NAME, a_name, is_name
from groundstation.core.messages import Ask
from links.io import is_loopback

PORT, PORT_TLS = 1883, 8883
"""What IANA has registered, without and with TLS."""

RemoteAsk = Literal["hold", "return", "track", "land", "descend", "abort", "kill"]
"""What may be asked from afar: everything but to arm."""


class TlsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Encryption, and who the broker proves to be."""

    enabled: bool = False
    """Speak TLS."""
    ca_file: str = ""
    """PEM file of the authority that has signed the broker's certificate; empty for those that the system trusts."""
    cert_file: str = ""
    """PEM file of our own certificate, where the broker asks for one; empty for none."""
    key_file: str = ""
    """PEM file of its private key, mode 0600."""
    verify: bool = True
    """Check the broker's certificate and name. Without it anybody may pose as the broker: a warning at each start."""

    def __post_init__(self) -> None:
        """Check what the fields alone can't.

        Raises:
            ValueError: half of a certificate, or files that nobody reads.
        """
        if bool(self.cert_file) != bool(self.key_file):
            raise ValueError("cert_file and key_file: expected both, or none")
        if not self.enabled and (self.ca_file or self.cert_file or not self.verify):
            raise ValueError("enabled: expected true where any other key of TLS is set, got false")


class ClientConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One client that may ask by MQTT."""

    key_file: str
    """File with the key that it shares with us, mode 0600; `groundstation mqtt make-key FILE` makes one."""
    may: Annotated[tuple[RemoteAsk, ...], msgspec.Meta(min_length=1)]
    """What it may ask."""


class RequestsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Requests by MQTT."""

    enabled: bool = False
    """Take any at all."""
    clients: dict[str, ClientConfig] = {}
    """Who may ask, by name."""

    def __post_init__(self) -> None:
        """Check what the fields alone can't.

        Raises:
            ValueError: nobody may ask, or a name that is none.
        """
        if self.enabled and not self.clients:
            raise ValueError("clients: expected at least one where enabled = true; or leave requests off")
        for name in self.clients:
            if not is_name(name, CLIENT_LETTERS):
                raise ValueError(f"clients: expected {a_name(CLIENT_LETTERS)}, got {name!r}")


class MqttConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The broker to publish to."""

    enabled: bool = False
    """Publish at all."""
    host: Annotated[str, msgspec.Meta(min_length=1)] = "127.0.0.1"
    """Name or address of the broker, as in its certificate."""
    port: Annotated[int, msgspec.Meta(ge=1, le=65535)] | None = None
    """TCP port of the broker; without it 8883 with TLS, 1883 without."""
    tls: TlsConfig = TlsConfig()
    insecure: bool = False
    """Speak to another machine without TLS: whoever is on the network reads everything, passwords too."""
    username: str = ""
    """Name to log in with; empty for none."""
    password_file: str = ""
    """File whose first line is the password, mode 0600; empty for none."""
    prefix: Annotated[str, msgspec.Meta(pattern=rf"\A{NAME}(/{NAME})*\Z", max_length=64)] = "groundstation"
    """First part of every topic."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=50.0)] = 5.0
    """Most snapshots a second [1/s]."""
    health_period_s: Annotated[float, msgspec.Meta(ge=0.1, le=3600.0)] = 5.0
    """Time between two words about the connection itself [s]."""
    requests: RequestsConfig = RequestsConfig()

    def __post_init__(self) -> None:
        """Check what the fields alone can't.

        Raises:
            ValueError: what is published would cross a network in clear, and nobody has said that it may.
        """
        if self.enabled and not self.tls.enabled and not self.insecure and not is_loopback(self.host):
            raise ValueError(
                f"host: {self.host!r} is another machine, and nothing would be encrypted: "
                "set mqtt.tls.enabled = true, or mqtt.insecure = true if everybody on the network may read it"
            )
        if self.password_file and not self.username:
            raise ValueError("username: expected a name beside password_file")

    @property
    def tcp_port(self) -> int:
        """The port in force."""
        return self.port or (PORT_TLS if self.tls.enabled else PORT)


def asks(config: ClientConfig) -> frozenset[Ask]:
    """What that client may ask."""
    return frozenset(map(Ask, config.may))
