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
        INVALID,
        NAV_LAND,
        PX4,
        REQUEST_MESSAGE,
        SET_MESSAGE_INTERVAL,
        STALE_NEWS_S,
        TICKS_PER_S,
        HeartbeatMonitor,
        MavlinkCodec,
        Message,
        Odometry,
        Signer,
        Vitals,
        Words,
        frame_end,
        odometry,
    )
    from links.mavlink.protocol.config import ForwardConfig, MavlinkLinkConfig
    from links.mavlink.protocol.procedures import (
        MULTIROTORS,
        REAL32,
        WHOLE_BITS,
        AskMode,
        AutopilotAddress,
        AutopilotParameter,
        Handshake,
        HandshakeStep,
        Kill,
        ReadAll,
        ReadVersion,
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


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
