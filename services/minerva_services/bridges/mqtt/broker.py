"""Address and credentials of a broker; secrets stay out of world files and of `repr`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import SplitResult, urlsplit

from minerva_bus.errors import MisuseError

_PORTS: Final = {"mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class Login:
    """Client id, user, and where the password and certificates are stored."""

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
        if self.password_env:
            password = os.environ.get(self.password_env)
            if password is None:
                raise MisuseError(f"mqtt: environment variable {self.password_env} is not set")
            return password
        if not self.password_file:
            return None
        try:
            return Path(self.password_file).read_text(encoding="utf-8").rstrip("\r\n")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
            raise MisuseError(f"mqtt: password_file {self.password_file}: {reason}") from None


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
