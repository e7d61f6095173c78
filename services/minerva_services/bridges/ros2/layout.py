"""Layout of ROS 2 topics on a Zenoh network: keys, liveliness tokens and attachments.

There are two layouts: *rmw_zenoh* is that of ROS 2's own middleware for Zenoh [rmw_zenoh,
docs/design.md], *dds* that of a zenoh-bridge-ros2dds next to a DDS robot. The payload is the
message in CDR in both.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from minerva_bus.errors import MisuseError, nearest
from minerva_services.bridges.ros2.graph import CPU, LAYOUTS, dds_type, mangled
from minerva_services.bridges.ros2.qos import Qos

ENDPOINTS: Final = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
SECURED: Final = ("tls", "quic")
GID_BYTES: Final = 16
_ATTACHMENT: Final = struct.Struct(f"<qqB{GID_BYTES}s")
_CPU_ONLY: Final = f"backends:{CPU}:"
"""Part of a subscription's token from Lyrical on: memory shared by devices is not understood."""

_CPU_KEY: Final = "_buf_cpu"
"""Where such subscriptions receive messages with bytes, as long as all are of this kind."""


@dataclass(frozen=True, slots=True)
class Ros2Network:
    """A robot's Zenoh network, and the layout of ROS 2 on it: options that all services share.

    Args:
        router: the endpoint of the robot's Zenoh router (rmw_zenohd, zenohd) or of a
          zenoh-bridge-ros2dds.
        layout: "rmw_zenoh", or "dds" for a zenoh-bridge-ros2dds.
        domain: the ROS domain, for rmw_zenoh.
        namespace: prefix of all topics that do not begin with a slash; of all topics if it is that
          of a zenoh-bridge-ros2dds, which prefixes them all.
        tf: topic of the transforms; those that never change are on it with _static appended.
        authority: for tls/ and quic/: PEM file of the authority that signed the router's
          certificate.
        certificate: PEM file of a client certificate, if the router requires one.
        key: PEM file of its private key.

    Raises MisuseError for invalid values.

    """

    router: str
    layout: str = "rmw_zenoh"
    domain: int = 0
    namespace: str = ""
    tf: str = "/tf"
    authority: str = ""
    certificate: str = ""
    key: str = ""

    def __post_init__(self) -> None:
        if self.layout not in LAYOUTS:
            hint = nearest(self.layout, list(LAYOUTS), f"expected {' or '.join(LAYOUTS)}")
            raise MisuseError(f"ros2: layout is {self.layout!r}{hint}")
        protocol, _, address = self.router.partition("/")
        if protocol not in ENDPOINTS or not address:
            raise MisuseError(f"ros2: {self.router!r} is not an endpoint; expected tcp/HOST:7447")
        if not 0 <= self.domain <= 232:
            raise MisuseError(f"ros2: domain is {self.domain}; expected 0 to 232")
        if self.namespace.strip("/"):
            check_name("namespace", self.namespace)
        self.name(self.tf)
        self._check_certificates(protocol)

    def _check_certificates(self, protocol: str) -> None:
        for name in ("authority", "certificate", "key"):
            path = getattr(self, name)
            if path and not Path(path).is_file():
                raise MisuseError(f"ros2: {name} is {path!r}; expected a PEM file")
        if bool(self.certificate) != bool(self.key):
            raise MisuseError("ros2: certificate and key belong together; set both or neither")
        if self.tls_settings() and protocol not in SECURED:
            raise MisuseError(
                f"ros2: certificates require tls/ or quic/, but the router is {self.router}"
            )

    def tls_settings(self) -> dict[str, str | bool]:
        """Zenoh's settings for transport/link/tls; empty without certificates."""
        files = {
            "root_ca_certificate": self.authority,
            "connect_certificate": self.certificate,
            "connect_private_key": self.key,
        }
        given = {name: str(Path(path).absolute()) for name, path in files.items() if path}
        return {**given, "enable_mtls": bool(self.certificate)} if given else {}

    @property
    def static_tf(self) -> str:
        """Topic of the transforms that never change."""
        return f"{self.tf}_static"

    def name(self, topic: str) -> str:
        """A topic's full name without the leading slash. Raises MisuseError."""
        check_name("a topic", topic)
        namespace, is_absolute = self.namespace.strip("/"), topic.startswith("/")
        # In the layout of dds, the namespace is not the robot's own, but that of its bridge.
        if not namespace or (is_absolute and self.layout != "dds"):
            return topic.strip("/")
        return f"{namespace}/{topic.strip('/')}"

    def key_of(self, topic: str, message: str, type_hash: str) -> str:
        """The key on which a topic of a message type is published."""
        name = self.name(topic)
        if self.layout == "dds":
            return name
        return f"{self.domain}/{name}/{dds_type(message)}/{type_hash}"

    def pattern(self, topic: str, message: str) -> str:
        """The key expression for a topic, for any version of its type."""
        name = self.name(topic)
        return name if self.layout == "dds" else f"{self.domain}/{name}/{dds_type(message)}/*"

    def buffered_pattern(self, topic: str, message: str) -> str:
        """The key expression on which Lyrical and later publish messages with bytes."""
        return f"{self.pattern(topic, message)}/{_CPU_KEY}"

    def node_token(self, session: str, node: str) -> str:
        """The liveliness token that announces a node in the ROS graph."""
        return f"@ros2_lv/{self.domain}/{session}/0/0/NN/%/{self._node_namespace}/{node}"

    @property
    def _node_namespace(self) -> str:
        return mangled(f"/{self.namespace.strip('/')}")

    def topic_token(
        self, session: str, node: str, entity: int, kind: Literal["MP", "MS", "SC"],
        topic: str, message: str, type_hash: str, qos: Qos, *, buffered: bool = False,
    ) -> str:  # fmt: skip
        """The token of a publisher (MP), a subscription (MS) or a client of a service (SC).

        `buffered` means that it also receives on `buffered_pattern`.
        """
        name = mangled(f"/{self.name(topic)}")
        return (
            f"@ros2_lv/{self.domain}/{session}/0/{entity}/{kind}/%/{self._node_namespace}/{node}"
            f"/{name}/{dds_type(message)}/{type_hash}/{qos.token}"
            f"{f'/{_CPU_ONLY}' if buffered else ''}"
        )


@dataclass(frozen=True, slots=True)
class Attachment:
    """Attachment of a message in rmw_zenoh: sequence number, time and publisher."""

    sequence: int
    nanoseconds: int
    gid: bytes

    def packed(self) -> bytes:
        """33 bytes: two little-endian int64, the length of the gid, the gid."""
        return _ATTACHMENT.pack(self.sequence, self.nanoseconds, GID_BYTES, self.gid)

    @staticmethod
    def unpacked(data: bytes) -> Attachment:
        """Inverse of `packed`. Raises MisuseError for other bytes."""
        if len(data) != _ATTACHMENT.size or data[16] != GID_BYTES:
            raise MisuseError(
                f"{len(data)} bytes are not an attachment; expected {_ATTACHMENT.size}"
            )
        sequence, nanoseconds, _, gid = _ATTACHMENT.unpack(data)
        return Attachment(sequence, nanoseconds, gid)


def gid_of(token: str) -> bytes:
    """The identifier of an endpoint, as all nodes of a network derive it from its token."""
    import xxhash  # late: optional dependency (extra "ros")

    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(GID_BYTES, "little")


def check_name(what: str, name: str) -> None:
    """Validate a topic name. Raises MisuseError."""
    parts = name.strip("/").split("/")
    if not all(part and part.replace("_", "a").isalnum() and part.isascii() for part in parts):
        raise MisuseError(
            f"ros2: {name!r} is not a valid name for {what}; expected letters,"
            " digits and _, separated by /"
        )
