"""Address and credentials of a broker; secrets stay out of world files and of `repr`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from urllib.parse import SplitResult, urlsplit

from minerva_bus.errors import MisuseError
from minerva_services.options import read_password

_PORTS: Final = {"mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class Login:
    """Client id, user, and where the password and certificates are stored.

    Args:
        client: the client id; assigned by the broker by default.
        user: user name; its password is in an environment variable or a file.
        password_env: the environment variable.
        password_file: the file.
        ca: a PEM file of trusted authorities; the system's by default.
        cert: a PEM file with a client certificate, for brokers that require one.
        key: its key, if that is in another file.

    Raises MisuseError for options that exclude or require each other.

    """

    client: str = ""
    user: str = ""
    password_env: str = ""
    password_file: str = ""
    ca: str = ""
    cert: str = ""
    key: str = ""

    def __post_init__(self) -> None:
        if self.password_env and self.password_file:
            raise MisuseError("mqtt: set password_env or password_file, not both")
        if (self.password_env or self.password_file) and not self.user:
            raise MisuseError("mqtt: a password requires the option user")
        if self.key and not self.cert:
            raise MisuseError("mqtt: a key requires the option cert")

    def password(self) -> str | None:
        """The password, read from its storage. Raises MisuseError."""
        if not self.password_env and not self.password_file:
            return None
        return read_password("mqtt", self.password_env, self.password_file)


@dataclass(frozen=True, slots=True)
class Broker:
    """Address of a broker."""

    host: str
    port: int
    tls: bool

    @staticmethod
    def at(address: str) -> Broker:
        """Parse `mqtt://HOST[:PORT]`, or `mqtts://` for TLS. Raises MisuseError."""
        url = address if "://" in address else f"mqtt://{address}"
        try:
            parts = urlsplit(url)
            # Raises ValueError for a number above 65535.
            port = parts.port
        except ValueError:
            raise _bad_address(address) from None
        if parts.scheme not in _PORTS or not parts.hostname or _has_extra_parts(parts):
            raise _bad_address(address)
        if parts.username is not None or parts.password is not None:
            raise MisuseError(
                "mqtt: user and password do not belong in the address; use the options user and"
                " password_env or password_file"
            )
        return Broker(parts.hostname, port or _PORTS[parts.scheme], parts.scheme == "mqtts")

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def _has_extra_parts(parts: SplitResult) -> bool:
    return bool(parts.path.strip("/") or parts.query or parts.fragment)


def _bad_address(address: str) -> MisuseError:
    shown = address.rpartition("@")[2]  # the part before may contain a password
    return MisuseError(
        f"mqtt: broker is {shown!r}; expected mqtt://HOST, mqtt://HOST:PORT or mqtts://HOST for TLS"
    )
