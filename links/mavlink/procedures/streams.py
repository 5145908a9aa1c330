"""Which messages an autopilot sends: those that are wanted at their rates, and no idle talk beside them."""

from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from links.core import LinkError, LinkLost
from links.mavlink.procedures.handshake import silence, stream
from links.mavlink.procedures.steps import Autopilot, Handshake
from links.mavlink.protocol import ESTIMATE, ESTIMATE_HZ

QUIETENED = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY",
    "ATTITUDE_TARGET", "HIGHRES_IMU", "RAW_IMU", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "ALTITUDE",
    "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT",
)  # fmt: skip
"""What autopilots send by default, ten times a second or more, and what nobody here reads unless asked for."""


async def choose_streams(
    autopilot: Autopilot,
    wanted: Mapping[str, float],
    wishes: Mapping[tuple[str, ...], float],
    see_through: Callable[[Handshake], Awaitable[None]],
    *,
    quiet: bool,
) -> None:
    """Have the messages in ``wanted`` sent (name → rate [Hz]), and with ``quiet`` no others that come often.

    Asked for, too, but not needed: what its estimator knows of itself, and of each of ``wishes`` (names → rate [Hz])
    the first message that it is willing to send, unless one of them is wanted anyhow.

    Raises:
        LinkRejected: the autopilot refuses to send one of them.
        LinkLost: it does not answer.
    """
    wishes = {names: rate for names, rate in wishes.items() if not any(name in wanted for name in names)}
    spoken = {*wanted, *(names[0] for names in wishes)}
    spare = [[silence(autopilot, name)] for name in QUIETENED if quiet and name not in spoken]
    if autopilot.kind in ESTIMATE and ESTIMATE[autopilot.kind] not in wanted:
        spare.append([stream(autopilot, ESTIMATE[autopilot.kind], ESTIMATE_HZ)])
    spare += [[stream(autopilot, name, rate) for name in names] for names, rate in wishes.items()]
    with suppress(LinkLost):  # it takes no such commands; a link with idle talk on it works too
        for steps in spare:
            for step in steps:
                try:
                    await see_through(step)
                    break
                except LinkLost:
                    raise
                except LinkError:
                    continue
    for name, rate in wanted.items():
        await see_through(stream(autopilot, name, rate))
