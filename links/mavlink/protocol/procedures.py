"""Procedures: what an autopilot must go through with us: arming, disarming, choosing what it sends. Sans-IO.

The caller streams set-points while they last. What shapes them, measured on PX4 1.16-alpha and ArduCopter 4.8-dev:

- PX4 arms in OFFBOARD only after set-points have come for about a second. Before, it still accepts the mode
  while disarmed, and then denies to arm; so the acceptance of the mode proves nothing, and streaming comes first.
- HEARTBEAT tells mode and armed state only once a second: what counts is COMMAND_ACK.
- PX4 denies to disarm for 1-3 s after touchdown, until it believes that it stands.
- ArduCopter takes thrust as a climb rate unless GUID_OPTIONS has bit 3 set, and raises the thrust of a leaning
  vehicle, as our controller has done already, unless ATC_ANGLE_BOOST is 0.
- ArduCopter refuses to disarm in GUIDED after a touchdown at zero thrust; mode LAND disarms by itself.
"""

from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.protocol.codec import ARDUPILOT, ARM_DISARM, DO_SET_MODE, PX4, SET_MESSAGE_INTERVAL
from links.mavlink.protocol.parameters import ParameterMust
from links.mavlink.protocol.status import ESTIMATE, ESTIMATE_HZ
from links.mavlink.protocol.steps import (
    PATIENCE_S,
    AutopilotAddress,
    Disarmed,
    Exchange,
    Handshake,
    HandshakeStep,
    Wait,
)

STREAM_S = 1.2
"""Set-points stream for this long before anything is asked [s]; PX4 wants a second of them."""
LAND_S = 10.0
"""How long mode LAND may take to disarm a vehicle that stands on the ground [s]."""

GUIDED_MODES = {"GUIDED": (1.0, 4.0), "GUIDED_NOGPS": (1.0, 20.0)}
"""ArduPilot's modes that follow set-points: parameters of DO_SET_MODE."""
MULTIROTORS = {2: "quadrotor", 3: "coaxial", 13: "hexarotor", 14: "octorotor", 15: "tricopter", 29: "dodecarotor"}
"""HEARTBEAT.type of vehicles that thrust and body rates fly."""

_OFFBOARD = (1.0, 6.0)
_LAND_MODE = {PX4: (1.0, 4.0, 6.0), ARDUPILOT: (1.0, 9.0)}
_THRUST_AS_THRUST = 8


def fitness(autopilot: AutopilotAddress) -> Handshake:
    """What it is asked before it is armed, and can be asked without arming.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot, or the vehicle no multirotor.
    """
    return Handshake(_musts(autopilot))


def arming(autopilot: AutopilotAddress, guided: str = "GUIDED") -> Handshake:
    """Into the mode that follows our set-points, then motors on; the caller streams set-points throughout.

    ``guided`` is which of ``GUIDED_MODES`` that is on ArduPilot.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot, or the vehicle no multirotor.
    """
    steps: list[HandshakeStep] = [Wait(STREAM_S), *_musts(autopilot)]
    mode, params = ("OFFBOARD", _OFFBOARD) if autopilot.kind == PX4 else (guided, GUIDED_MODES[guided])
    hint = f"Switch to {mode} by hand to see what it lacks: it needs an attitude and our stream of set-points."
    steps.append(Exchange(autopilot, f"enter {mode}", DO_SET_MODE, params, hint))
    hint = "Clear what it names (its pre-arm checks tell more), then arm again."
    steps.append(Exchange(autopilot, "arm", ARM_DISARM, (1.0, 0.0), hint))
    return Handshake(steps)


def _musts(autopilot: AutopilotAddress) -> list[HandshakeStep]:
    """What we insist on; raises LinkRejected, see :func:`arming`."""
    if autopilot.kind not in (PX4, ARDUPILOT):
        raise LinkRejected(
            f"system {autopilot.system} is no PX4 and no ArduPilot (MAV_AUTOPILOT {autopilot.kind}): "
            "nobody tried how it takes body rates, so it is not armed"
        )
    if autopilot.vehicle not in MULTIROTORS:
        raise LinkRejected(
            f"{autopilot.name} says that its vehicle is no multirotor (MAV_TYPE {autopilot.vehicle}): it may take our "
            "thrust for something else, so it is not armed. Set its frame or airframe to the multirotor that it is"
        )
    if autopilot.kind == PX4:
        return []
    hint = (
        "it would take our thrust as a climb rate. Set GUID_OPTIONS to 8 (bit 3, thrust as "
        "thrust; `groundstation doctor` does), then arm again."
    )
    thrust = ParameterMust(autopilot, "GUID_OPTIONS", lambda v: bool(v & _THRUST_AS_THRUST), hint)
    hint = (
        "it would raise our thrust whenever the vehicle leans, on top of the controller, which does so already. "
        "Set ATC_ANGLE_BOOST to 0 (`groundstation doctor` does), then arm again."
    )
    return [thrust, ParameterMust(autopilot, "ATC_ANGLE_BOOST", lambda v: v == 0, hint)]


def disarming(autopilot: AutopilotAddress) -> Handshake:
    """Motors off, with patience until the autopilot believes that it stands."""
    hint = "It must stand on the ground at zero thrust; the remote control's kill switch always works."
    # ArduPilot that refuses goes on refusing: mode LAND is its way (see landing_disarmed).
    patience_s = 0.0 if autopilot.kind == ARDUPILOT else PATIENCE_S
    return Handshake([Exchange(autopilot, "disarm", ARM_DISARM, (0.0, 0.0), hint, patience_s=patience_s)])


def landing_disarmed(autopilot: AutopilotAddress) -> Handshake:
    """ArduPilot's own way from standing on the ground to motors off: mode LAND."""
    hint = "Stop the motors with the remote control."
    return Handshake([Exchange(autopilot, "enter LAND", DO_SET_MODE, _LAND_MODE[ARDUPILOT], hint), Disarmed(LAND_S)])


def landing(autopilot: AutopilotAddress) -> Handshake:
    """Into the mode that lands by the autopilot's own estimate, in the air; asked for while the bring-down is sent.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot.
    """
    if autopilot.kind not in _LAND_MODE:
        raise LinkRejected(f"nobody knows how autopilot {autopilot.kind} is told to land")
    hint = "The bring-down by rates went on instead."
    return Handshake([Exchange(autopilot, "enter LAND", DO_SET_MODE, _LAND_MODE[autopilot.kind], hint)])


def stream(autopilot: AutopilotAddress, name: str, rate_hz: float) -> Handshake:
    """Have the message ``name`` sent ``rate_hz`` times a second."""
    params = (float(autopilot.codec.message_number(name)), 1e6 / rate_hz)
    hint = "This autopilot may not have the message; do without what it is for (pose.kind, operator.hold)."
    what = f"send {name} at {rate_hz:g} Hz"
    return Handshake([Exchange(autopilot, what, SET_MESSAGE_INTERVAL, params, hint, patience_s=0.0)])


def silence(autopilot: AutopilotAddress, name: str) -> Handshake:
    """Have the message ``name`` sent no more; one that the autopilot does not have is silent already."""
    params = (float(autopilot.codec.message_number(name)), -1.0)
    return Handshake(
        [Exchange(autopilot, f"stop sending {name}", SET_MESSAGE_INTERVAL, params, hint="", any_answer=True)]
    )


QUIETENED = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY",
    "ATTITUDE_TARGET", "HIGHRES_IMU", "RAW_IMU", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "ALTITUDE",
    "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT",
)  # fmt: skip
"""What autopilots send by default, ten times a second or more, and what nobody here reads unless asked for."""


async def choose_streams(
    autopilot: AutopilotAddress,
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
