"""Which messages an autopilot sends: those that are wanted at their rates, and no idle talk beside them."""

from collections.abc import Awaitable, Callable, Mapping

from links.mavlink_handshake import silence, stream
from links.mavlink_steps import Autopilot, Handshake
from links.port import LinkLost

QUIETENED = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY",
    "ATTITUDE_TARGET", "HIGHRES_IMU", "RAW_IMU", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "ALTITUDE",
    "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT",
)  # fmt: skip
"""What autopilots send by default, ten times a second or more, and what nobody here reads unless asked for."""


async def choose_streams(
    autopilot: Autopilot,
    wanted: Mapping[str, float],
    see_through: Callable[[Handshake], Awaitable[None]],
    *,
    quiet: bool,
) -> None:
    """Have the messages in ``wanted`` sent (name → rate [Hz]), and with ``quiet`` no others that come often.

    Raises:
        LinkRejected: the autopilot refuses to send one of them.
        LinkLost: it does not answer.
    """
    for name in QUIETENED if quiet else ():
        if name not in wanted:
            try:
                await see_through(silence(autopilot, name))
            except LinkLost:
                break  # it takes no such commands; a link with idle talk on it works too
    for name, rate in wanted.items():
        await see_through(stream(autopilot, name, rate))
