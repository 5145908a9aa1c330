"""What is said in MAVLink, sans-IO: codec, signing, time, heartbeat and status of an autopilot."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.mavlink.protocol.attitude import ATTITUDE_HZ, ATTITUDES, SLOW_BAUD, SLOW_HZ, attitude_of
    from links.mavlink.protocol.codec import (
        ARDUPILOT,
        ARM_DISARM,
        ARMED,
        DO_SET_MODE,
        FORCE,
        GROUND_STATION,
        NAV_LAND,
        PX4,
        REQUEST_MESSAGE,
        SET_MESSAGE_INTERVAL,
        MavlinkCodec,
        Message,
        frame_end,
    )
    from links.mavlink.protocol.config import ForwardConfig, MavlinkLinkConfig
    from links.mavlink.protocol.dialect import DIALECT
    from links.mavlink.protocol.heartbeat import STALE_NEWS_S, Heard
    from links.mavlink.protocol.odometry_codec import Odometry, odometry
    from links.mavlink.protocol.signing import TICKS_PER_S, Signer
    from links.mavlink.protocol.status import ESTIMATE, ESTIMATE_HZ, Vitals, Words
    from links.mavlink.protocol.timesync import Timesync, Trip

_MODULES = {
    "attitude": ("ATTITUDES", "ATTITUDE_HZ", "SLOW_BAUD", "SLOW_HZ", "attitude_of"),
    "codec": (
        "ARDUPILOT",
        "ARMED",
        "ARM_DISARM",
        "DO_SET_MODE",
        "FORCE",
        "GROUND_STATION",
        "MavlinkCodec",
        "Message",
        "NAV_LAND",
        "PX4",
        "REQUEST_MESSAGE",
        "SET_MESSAGE_INTERVAL",
        "frame_end",
    ),
    "config": ("ForwardConfig", "MavlinkLinkConfig"),
    "dialect": ("DIALECT",),
    "heartbeat": ("Heard", "STALE_NEWS_S"),
    "odometry_codec": ("Odometry", "odometry"),
    "signing": ("Signer", "TICKS_PER_S"),
    "status": ("ESTIMATE", "ESTIMATE_HZ", "Vitals", "Words"),
    "timesync": ("Timesync", "Trip"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
