"""What is said in MAVLink, sans-IO: codec, signing, clocks, status, parameters, and the procedures of an autopilot."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.mavlink.protocol.codec import (
        ARDUPILOT,
        ARM_DISARM,
        ARMED,
        DIALECT,
        DO_SET_MODE,
        FORCE,
        GROUND_STATION,
        NAV_LAND,
        PX4,
        REQUEST_MESSAGE,
        SET_MESSAGE_INTERVAL,
        MavlinkCodec,
        Message,
        Odometry,
        frame_end,
        odometry,
    )
    from links.mavlink.protocol.config import ForwardConfig, MavlinkLinkConfig
    from links.mavlink.protocol.procedures import (
        MULTIROTORS,
        REAL32,
        WHOLE_BITS,
        AutopilotParameter,
        ReadAll,
        Write,
        arming,
        choose_streams,
        decode,
        disarming,
        encode,
        fitness,
        is_same,
        landing,
        landing_disarmed,
    )
    from links.mavlink.protocol.signing import TICKS_PER_S, Signer
    from links.mavlink.protocol.status import STALE_NEWS_S, HeartbeatMonitor, Vitals, Words
    from links.mavlink.protocol.steps import (
        AskMode,
        AutopilotAddress,
        Handshake,
        HandshakeStep,
        Kill,
        ReadVersion,
        make_mode_request,
    )
    from links.mavlink.protocol.timesync import (
        ATTITUDE_HZ,
        ATTITUDES,
        LONGEST_S,
        SLOW_BAUD,
        SLOW_HZ,
        Timesync,
        Trip,
        attitude_of,
    )

_MODULES = {
    "codec": (
        "ARDUPILOT",
        "ARMED",
        "ARM_DISARM",
        "DIALECT",
        "DO_SET_MODE",
        "FORCE",
        "GROUND_STATION",
        "MavlinkCodec",
        "Message",
        "NAV_LAND",
        "Odometry",
        "PX4",
        "REQUEST_MESSAGE",
        "SET_MESSAGE_INTERVAL",
        "frame_end",
        "odometry",
    ),
    "config": ("ForwardConfig", "MavlinkLinkConfig"),
    "procedures": (
        "AutopilotParameter",
        "MULTIROTORS",
        "REAL32",
        "ReadAll",
        "WHOLE_BITS",
        "Write",
        "arming",
        "choose_streams",
        "decode",
        "disarming",
        "encode",
        "fitness",
        "is_same",
        "landing",
        "landing_disarmed",
    ),
    "signing": ("Signer", "TICKS_PER_S"),
    "status": ("HeartbeatMonitor", "STALE_NEWS_S", "Vitals", "Words"),
    "steps": ("AskMode", "AutopilotAddress", "Handshake", "HandshakeStep", "Kill", "ReadVersion", "make_mode_request"),
    "timesync": ("ATTITUDES", "ATTITUDE_HZ", "LONGEST_S", "SLOW_BAUD", "SLOW_HZ", "Timesync", "Trip", "attitude_of"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
