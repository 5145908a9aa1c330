"""Common parts of all links, sans-IO: the port, the dead man's switch, the thrust curve."""

from links.core.deadman import (
    BRING_DOWN_LIMIT_S,
    DEADLINE_LIMIT_S,
    NEWS_S,
    REOPEN_S,
    STALL_S,
    STUCK_S,
    TICK_S,
    Arrival,
    Attitude,
    Command,
    CommandLink,
    Deadman,
    LinkError,
    LinkKind,
    LinkLost,
    LinkMisuse,
    LinkRejected,
    LinkStatus,
    Phase,
    Segment,
    from_euler_zyx,
    full_thrust_n,
    signal,
    thrust,
)
from links.core.lateness import Lateness
