"""MAVLink sans-IO: codec, signing, clocks, status, parameters, an autopilot's procedures."""

from links.mavlink.protocol.autopilot_state import (
    STALE_NEWS_S,
    HeartbeatMonitor,
    Vitals,
    Words,
    is_autopilot,
)
from links.mavlink.protocol.codec import (
    ARDUPILOT,
    ARMED,
    FORCE,
    GROUND_STATION,
    INVALID,
    MOST_SENDERS,
    PX4,
    AttitudeTargetMask,
    EstimatorFlag,
    EstimatorKind,
    MavCommand,
    MavFrame,
    MavlinkCodec,
    MavResult,
    MavSeverity,
    Message,
    frame_end,
    load_dialect,
)
from links.mavlink.protocol.config import ForwardConfig, MavlinkLinkConfig
from links.mavlink.protocol.odometry_codec import Odometry, encode_odometry, encode_origin
from links.mavlink.protocol.procedures import (
    MULTIROTORS,
    STREAM_S,
    WHOLE_BITS,
    AskMode,
    AutopilotAddress,
    AutopilotParameter,
    Handshake,
    HandshakeStep,
    Kill,
    MavParamType,
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
)
from links.mavlink.protocol.senders import OtherTraffic, TargetSenders
from links.mavlink.protocol.signing import LAST_STAMP, TICKS_PER_S, Signer
from links.mavlink.protocol.timesync import (
    ATTITUDE_HZ,
    ATTITUDES,
    LONGEST_S,
    NEWEST,
    SLOW_BAUD,
    SLOW_HZ,
    Timesync,
    Trip,
    attitude_of,
)
from links.mavlink.protocol.uplink import QUESTION_S, SLOW_QUESTION_S, Uplink
