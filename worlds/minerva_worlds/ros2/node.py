"""A ROS 2 node without ROS: CDR messages on Zenoh, in the layout of rmw_zenoh."""

import json
import math
import struct
import time

import zenoh
import zenoh.ext
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

VISION = {
    "Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    "Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox3D bbox\nstring id",
    "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose",
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
}

SERVICE_HASH = f"RIHS01_{0:064x}"

store = get_typestore(Stores.LATEST)
definitions = {}
for vision_type, fields in VISION.items():
    definitions |= get_types_from_msg(fields, f"vision_msgs/msg/{vision_type}")
store.register(definitions)


def make(name, /, **values):
    """A ROS message."""
    return store.types[name](**values)


def vector(x=0.0, y=0.0, z=0.0):
    return make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def pose(x, y, angle=0.0):
    half = angle / 2
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=make(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)
        ),
    )


class Ros:
    """A node that uses the protocol of rmw_zenoh."""

    def __init__(self, listen, domain):
        config = zenoh.Config()
        for key, value in {
            "mode": "router",
            "listen/endpoints": [listen],
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.domain = domain
        self.publishers = {}
        self.subscribers = []
        self.tokens = []
        self.announce("NN")

    def key(self, topic, message):
        package, kind, name = message.split("/")
        type_hash = store.hash_rihs01(message)
        return f"{self.domain}/{topic}/{package}::{kind}::dds_::{name}_/{type_hash}"

    def announce(self, kind, key="", qos=""):
        """Announce the node (NN), a publisher (MP), subscription (MS) or service (SS)."""
        about = f"@ros2_lv/{self.domain}/{self.session.zid()}/0/{len(self.tokens)}/{kind}/%/%/robot"
        if key:
            topic, message, type_hash = key.partition("/")[2].rsplit("/", 2)
            about += f"/%{topic.replace('/', '%')}/{message}/{type_hash}/{qos}"
        self.tokens.append(self.session.liveliness().declare_token(about))

    def advertise(self, topic, message, lasting=False):
        key = self.key(topic, message)
        if lasting:
            cache = zenoh.ext.CacheConfig(1)
            publisher = zenoh.ext.declare_advanced_publisher(
                self.session, key, cache=cache, publisher_detection=True
            )
        else:
            publisher = self.session.declare_publisher(key)
        self.publishers[topic] = [message, publisher, 0]
        self.announce("MP", key, ":1:,1:,:,:,," if lasting else "::,10:,:,:,,")

    def publish(self, topic, value):
        message, publisher, number = self.publishers[topic]
        self.publishers[topic][2] = number + 1
        attachment = struct.pack("<qqB16s", number + 1, time.time_ns(), 16, topic.encode()[:16])
        publisher.put(bytes(store.serialize_cdr(value, message)), attachment=attachment)

    def subscribe(self, topic, message, receive):
        def on_sample(sample):
            receive(store.deserialize_cdr(sample.payload.to_bytes(), message))

        key = self.key(topic, message)
        self.subscribers.append(self.session.declare_subscriber(key, on_sample))
        self.announce("MS", key, "::,10:,:,:,,")

    def serve(self, service, kind, answer):
        """Serve a service; `answer` receives each query, and replies to it when it likes."""
        package, group, name = kind.split("/")
        # A real node has the hash of the type here, or no hash in Humble; clients copy it.
        key = f"{self.domain}/{service}/{package}::{group}::dds_::{name}_/{SERVICE_HASH}"
        self.subscribers.append(self.session.declare_queryable(key, answer, complete=True))
        self.announce("SS", key, "::,10:,:,:,,")

    def close(self):
        self.session.close()


def read(query, message):
    """The request of a query."""
    return store.deserialize_cdr(query.payload.to_bytes(), message)


def reply(query, message, /, **values):
    """Answer a query; the attachment tells the client which request it was."""
    data = bytes(store.serialize_cdr(make(message, **values), message))
    with query:
        query.reply(query.key_expr, data, attachment=query.attachment)
