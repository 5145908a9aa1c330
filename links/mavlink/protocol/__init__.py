"""MAVLink sans-IO: codec, signing, clocks, status, parameters, hand-shakes with an autopilot."""

from links.mavlink.protocol.autopilot_state import (
    STALE_HEARTBEAT_S,
    AutopilotTexts,
    HeartbeatMonitor,
    Vitals,
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
    find_frame_end,
    load_dialect,
)
from links.mavlink.protocol.config import ForwardConfig, MavlinkLinkConfig
from links.mavlink.protocol.odometry_codec import Odometry, encode_odometry, encode_origin
from links.mavlink.protocol.procedures import (
    INTEGER_BITS,
    MULTIROTORS,
    STREAM_S,
    AskMode,
    AutopilotAddress,
    AutopilotParameter,
    Handshake,
    HandshakeStep,
    Kill,
    MavParamType,
    ReadParameters,
    ReadVersion,
    WriteParameter,
    choose_streams,
    decode_parameter,
    encode_parameter,
    is_same_float32,
    make_arming,
    make_checks,
    make_disarming,
    make_landing,
    make_landing_disarmed,
)
from links.mavlink.protocol.senders import OtherTraffic, TargetSenders
from links.mavlink.protocol.signing import LAST_STAMP, TICKS_PER_S, Signer
from links.mavlink.protocol.timesync import (
    ATTITUDE_HZ,
    ATTITUDES,
    LONGEST_TRAVEL_S,
    SLOW_BAUD,
    SLOW_HZ,
    TRIPS_KEPT,
    RoundTrip,
    Timesync,
    attitude_of,
)
from links.mavlink.protocol.uplink import QUESTION_S, SLOW_QUESTION_S, Uplink
