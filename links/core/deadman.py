"""Port of every command link, with its dead man's switch: fresh, bring-down, nothing. Sans-IO.

A command may be repeated until its deadline. After it the bring-down that the newest command
carries is played once, and then nothing leaves that lifts. Nothing but :meth:`Deadman.arm` ends
that: a command that comes late, or from a controller that has woken up again, is refused.

The port says what a command is, and how a link tells that it failed. A link turns a
:class:`Command` into bytes on a wire. It knows no control, no mission and no screen.

Thrust to motor signal: thrust = f u² + (1 - f) u, both 0..1.

This is how PX4 (THR_MDL_FAC) and ArduPilot (MOT_THST_EXPO) define it.
An autopilot that has its own curve set takes thrust and inverts the curve itself: then f is 0 here.

How many newtons the full signal gives is known best from hovering: the signal that carries the
vehicle stands in the autopilot's log (PX4: MPC_THR_HOVER; ArduPilot: MOT_THST_HOVER), while data
sheets tell of motors on a bench.
"""

import math
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, ClassVar, NamedTuple, Protocol

import msgspec

from links.text import Sentence


class Segment(msgspec.Struct, frozen=True, gc=False):
    """One part of a bring-down: thrust and body rates held for a while, without feedback."""

    duration_s: float
    """[s]"""
    thrust_n: float
    """Collective thrust [N], along -z of the body (FRD), >= 0."""
    rates_rad_s: tuple[float, float, float]
    """Body rates [rad/s], FRD."""


class Command(msgspec.Struct, frozen=True, gc=False):
    """One thrust and body-rate command, and the pose it came from."""

    thrust_n: float
    """Collective thrust [N], along -z of the body (FRD), >= 0."""
    rates_rad_s: tuple[float, float, float]
    """Body rates [rad/s], roll, pitch and yaw rate in the body frame (FRD)."""
    pose_id: int
    """Running number of the newest pose that the command was computed from."""
    pose_time_s: float
    """When that pose was true, on the event loop's clock [s]."""
    deadline_s: float
    """After this instant, on the event loop's clock [s], the command must not leave any more."""
    bring_down: tuple[Segment, ...] = ()
    """Segments after the deadline without a newer command: at most 2 s, then nothing that lifts."""


class Attitude(msgspec.Struct, frozen=True, gc=False):
    """Attitude and rates by the vehicle's own estimate."""

    time_s: float
    """When that was so, on the event loop's clock [s]."""
    attitude: tuple[float, float, float, float]
    """Unit quaternion w, x, y, z, body FRD to NED; its north is the vehicle's own."""
    rates_rad_s: tuple[float, float, float] | None
    """Body rates [rad/s], FRD; None where it tells none, as through a radio, which does not tell
    either when it was."""

    @property
    def angles_rad(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw [rad], turned yaw first."""
        w, x, y, z = self.attitude
        return (
            math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(max(-1.0, min(1.0, 2.0 * (w * y - x * z)))),
            math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)),
        )


UNIT_TOLERANCE = 1e-3
"""Largest difference from 1 of a unit quaternion's length, and from a rotation of a matrix [-];
32-bit floats leave it within 1e-6."""


def from_euler_zyx(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Convert angles [rad], about z, then y, then x, to the body-to-world quaternion w, x, y, z."""
    cr = math.cos(0.5 * roll)
    sr = math.sin(0.5 * roll)
    cp = math.cos(0.5 * pitch)
    sp = math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


class LinkError(Exception):
    """Anything that a link reports to the operator."""

    def __init__(self, says: Sentence | str) -> None:
        """``says`` is a sentence of the table, or plain words where somebody else has made them."""
        super().__init__(str(says))
        self.says = says


class LinkLost(LinkError):
    """The other end went silent or the wire is gone; connecting again may help."""


class LinkRejected(LinkError):
    """The autopilot refused; the message holds its own words and what to do about them."""


class LinkMisuse(LinkError):
    """The caller broke the port's contract (a bug in this program, not of the operator)."""


class LinkStatus(msgspec.Struct, frozen=True):
    """Status of a link, for screens and telemetry."""

    state: Annotated[
        str,
        msgspec.Meta(description="One of `closed`, `connecting`, `connected`, `armed`, `lost`."),
    ]
    sent: Annotated[int, msgspec.Meta(description="Commands that left.")]
    expired: Annotated[
        int,
        msgspec.Meta(
            description="Commands withheld: their deadline had passed, or a bring-down had begun "
            "and nobody has armed since."
        ),
    ]
    received: Annotated[int, msgspec.Meta(description="Messages received and understood.")]
    dropped: Annotated[
        dict[str, int],
        msgspec.Meta(description="Bytes or messages received and dropped, counted by reason."),
    ]
    text: Annotated[
        str,
        msgspec.Meta(
            description="The newest words of the other end (MAVLink STATUSTEXT), or an empty "
            "string."
        ),
    ]
    phase: Annotated[
        str,
        msgspec.Meta(
            description="What may leave (see deadman.py): `waiting`, `fresh`, `bring_down` or "
            "`over`."
        ),
    ] = "over"
    rtt_s: Annotated[
        float | None,
        msgspec.Meta(
            description="Shortest of the newest round trips to the other end and back [s]; None "
            "where it is not known."
        ),
    ] = None
    offset_s: Annotated[
        float | None,
        msgspec.Meta(
            description="The other end's clock less the event loop's [s]; None where it is not "
            "known."
        ),
    ] = None
    taken: Annotated[
        str,
        msgspec.Meta(
            description="The mode that somebody else has put the autopilot in since we armed it: "
            "nothing leaves any more; else empty."
        ),
    ] = ""
    battery_v: Annotated[
        float | None,
        msgspec.Meta(
            description="Voltage of the vehicle's battery [V]; None where it does not tell."
        ),
    ] = None
    battery_share: Annotated[
        float | None, msgspec.Meta(description="Its charge [-]; None where it does not tell.")
    ] = None
    ready: Annotated[
        bool | None,
        msgspec.Meta(
            description="Whether the vehicle's own pre-arm checks pass; None where it does not "
            "tell."
        ),
    ] = None
    mode: Annotated[
        str,
        msgspec.Meta(
            description="The mode that the vehicle's autopilot was in when it was heard last; "
            "empty where it does not tell."
        ),
    ] = ""
    unfit: Annotated[
        str,
        msgspec.Meta(
            description="Why `CommandLink.arm` would be refused, as `CommandLink.examine` found; "
            "empty where it found nothing."
        ),
    ] = ""
    firmware: Annotated[
        str,
        msgspec.Meta(
            description="What the vehicle's autopilot runs, as it tells itself; empty where it "
            "does not tell."
        ),
    ] = ""
    slept_s: Annotated[
        float,
        msgspec.Meta(
            description="How long the computer that sends has slept since the arming [s]: nothing "
            "more leaves, see links/io/wires.py."
        ),
    ] = 0.0
    late_octaves: Annotated[
        tuple[int, ...],
        msgspec.Meta(
            description="Frames by how late they left, where a pacer lets them go and tells: entry "
            "k counts those late by less than 2**k µs and not by less than 2**(k-1); of "
            "all frames since it began."
        ),
    ] = ()
    period_s: Annotated[
        float,
        msgspec.Meta(
            description="Time between two frames [s]; 0 where commands follow the poses, or where "
            "that is not known yet."
        ),
    ] = 0.0
    hears_vehicle: Annotated[
        bool,
        msgspec.Meta(
            description="Whether `connected` and `armed` are the vehicle's own words; False where "
            "nothing comes back from it, and they only say what was sent."
        ),
    ] = True
    warning: Annotated[
        str,
        msgspec.Meta(
            description="What an operator should know of how frames leave, before arming and in "
            "flight; empty where nothing is wrong."
        ),
    ] = ""
    conflict: Annotated[
        str,
        msgspec.Meta(
            description="Who else answers as the vehicle or steers it, so that it must not be "
            "armed; empty where nobody does."
        ),
    ] = ""
    other_addresses: Annotated[
        tuple[str, ...],
        msgspec.Meta(
            description="From where else something came to our port, a few of them; see "
            "`other_address` in `dropped`."
        ),
    ] = ()
    angles_rad: Annotated[
        tuple[float, ...],
        msgspec.Meta(
            description="Roll, pitch and yaw as the vehicle itself believes, its north its own "
            "[rad]; empty where it does not tell."
        ),
    ] = ()
    uplink_share: Annotated[
        float | None,
        msgspec.Meta(
            description="Share of our frames that its receiver gets [-]; None where it does not "
            "tell."
        ),
    ] = None
    uplink_dbm: Annotated[
        int | None, msgspec.Meta(description="Power that it gets of them [dBm].")
    ] = None
    uplink_snr_db: Annotated[
        int | None, msgspec.Meta(description="The same over the noise [dB].")
    ] = None
    unmet: Annotated[
        str,
        msgspec.Meta(
            description="Why what was owed to the vehicle since its arming, the newest command or "
            "its bring-down, does not leave from here, and who has to act; empty where "
            "it leaves or has left."
        ),
    ] = ""


class Arrival(NamedTuple):
    """Evidence that commands reach the autopilot."""

    overdue_s: float = 0.0
    """Time for which answers are overdue though it is heard [s]; 0 where nobody can tell."""
    late_s: float = 0.0
    """Delay of commands at the autopilot, by answers that stay late [s]; 0 where none is."""


class AutopilotLink(Protocol):
    """A link to an autopilot that answers: its mode, which others may change, and arrivals."""

    shares_poses: bool
    """Whether the poses that are flown by are the autopilot's own, or come to it from elsewhere
    too."""

    @property
    def lands_by_itself(self) -> bool:
        """Whether it has been asked to land by itself since the newest arming, and does."""

    def could_land_by_itself(self, now_s: float) -> bool:
        """Whether it would land, asked at ``now_s`` [s], by a position not made of our poses."""

    def ask_mode(self) -> None:
        """Have it tell its mode now: what it does not do may be somebody else's doing."""

    def land(self) -> None:
        """Ask it to land by itself now, where it can: no newer command comes, and the newest need
        not run out first.
        """

    def arrival(self, now_s: float) -> Arrival:
        """Whether commands reach it, and in time."""


class LinkKind(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"
):
    """Base of the configurations of all kinds of links, with the defaults of their properties."""

    has_autopilot: ClassVar[bool] = False
    """Whether the other end is an autopilot that reports its state, not a receiver that only
    listens."""

    @property
    def kind(self) -> str:
        """Name of the kind."""
        return str(self.__struct_config__.tag)

    @property
    def address_key(self) -> str:
        """Key with the address of the other end."""
        raise NotImplementedError

    @property
    def endpoint(self) -> str:
        """Address of the other end, host:port, or a serial port."""
        return str(getattr(self, self.address_key))

    @property
    def destination(self) -> str:
        """Destination of commands, to be compared with those of other flights on this machine."""
        return f"{self.kind} {self.endpoint}"

    @property
    def real(self) -> str | None:
        """The key that may lead to a real vehicle, and its value.

        None where all stays on this machine.
        """
        return f"kind = {self.kind}"

    @property
    def simulated(self) -> bool:
        """The operator says that a simulator is at the other end."""
        return False

    @property
    def follows_poses(self) -> bool:
        """A command leaves as soon as a pose has come, not at fixed times."""
        return False

    @property
    def period_s(self) -> float | None:
        """Time between two commands [s]; None where the other end tells it."""
        return None

    @property
    def own_position(self) -> bool:
        """The operator says that the autopilot's position is not made of our tracker's."""
        return False

    @property
    def key_files(self) -> dict[str, str]:
        """Files with a secret that the other end shares, by their keys."""
        return {}


class CommandLink(Protocol):
    """Port by which commands leave. Every method runs on the event loop; none blocks it.

    Behind every link is a dead man's switch (deadman.py). From an arming on, whatever becomes of
    the caller, the link repeats the newest command until its deadline, plays the bring-down that it
    carries, and then lets nothing leave that lifts until somebody calls :meth:`arm` again.
    """

    @property
    def period_s(self) -> float:
        """Time between two commands [s]."""

    @property
    def follows_poses(self) -> bool:
        """True where a command may leave as soon as a pose has come.

        False where every ``period_s`` is its time.
        """

    @property
    def status(self) -> LinkStatus:
        """The link as it is now."""

    @property
    def autopilot(self) -> AutopilotLink | None:
        """Requests to an autopilot at the other end; None where there is only a receiver."""

    def watch_attitude(self, watch: Callable[[Attitude], None]) -> None:
        """Call ``watch`` with every attitude that the vehicle tells.

        To be asked for before :meth:`connect`.

        Never called where the vehicle tells none.
        """

    async def connect(self) -> None:
        """Open the wire and wait for the other end.

        Raises:
            LinkLost: nobody answered within the configured time.
        """

    async def examine(self) -> None:
        """Ask the other end what arming hangs on, as far as that can be asked without arming.

        ``status.unfit`` and ``status.firmware`` tell it from then on. Changes nothing there.

        Raises:
            LinkLost: it did not answer.
            LinkMisuse: the link is not connected.
        """

    async def arm(self, idle: Callable[[], Command]) -> None:
        """Stream new ``idle()`` commands until the vehicle is armed and obeys.

        Only for an operator's own arming: it is the one thing that lets commands leave again after
        a bring-down.

        Raises:
            LinkRejected: the autopilot refused, in its own words.
            LinkLost: it did not answer.
        """

    def send(self, command: Command) -> bool:
        """Send one command now, and repeat it until its deadline if no other comes.

        Returns False, and changes nothing, where its deadline has passed, where a bring-down has
        begun, or where nobody has armed.

        Raises:
            LinkMisuse: a number in the command is not finite, its deadline or its bring-down is too
                long, or the link is not connected.
        """

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""

    async def disarm(self) -> None:
        """Ask the vehicle to stop its motors.

        Raises:
            LinkRejected: the autopilot refused, in its own words.
            LinkLost: it did not answer.
        """

    async def kill(self) -> None:
        """Stop the motors at once, also in the air: nothing else leaves from the call on.

        Works in every state.

        Raises:
            LinkLost: the vehicle did not acknowledge.
            LinkRejected: it refused, in its own words.
        """

    async def close(self) -> None:
        """Release the wire. Nothing leaves afterwards.

        A link that has something to repeat or to bring down does that to its end first (at most the
        coast limit and 2 s); only :meth:`kill` cuts it short.
        """


def signal(thrust: float, factor: float) -> float:
    """The signal u in 0..1 for ``thrust`` (clamped to 0..1) on the curve f = ``factor`` (0..1)."""
    if thrust <= 0.0:
        return 0.0
    if thrust >= 1.0:
        return 1.0
    linear = 1.0 - factor
    # The root of f u² + (1 - f) u - thrust = 0 in the form that also holds for f = 0.
    return 2.0 * thrust / (linear + math.sqrt(linear * linear + 4.0 * factor * thrust))


def thrust(signal_: float, factor: float) -> float:
    """The thrust 0..1 that the signal ``signal_`` (0..1) gives: the inverse of :func:`signal`."""
    return factor * signal_ * signal_ + (1.0 - factor) * signal_


def full_thrust_n(weight_n: float, hover: float, factor: float) -> float:
    """Thrust of the full signal [N], where ``hover`` (0..1, not 0) carries ``weight_n`` [N]."""
    return weight_n / thrust(hover, factor)


BRING_DOWN_LIMIT_S = 2.0
"""Longest bring-down [s]: without a pose nobody knows any more where the vehicle is."""
DEADLINE_LIMIT_S = 1.1
"""Furthest deadline [s from now]: no pose vouches for more than 1 s, nor one whose stamp lies in
the future (but for the jitter of clocks)."""
TICK_S = 1e-6
"""Tolerance for an instant [s]: timers fire up to a clock tick early, and clocks round."""
STALL_S = 0.06
"""A program that has not run for longer than this was stalled [s]."""
STUCK_S = 0.25
"""A wire or port that takes nothing for longer than this is lost [s]: the newest command is past
its deadline by then, and a shorter pause is flown through."""
NEWS_S = 3.0
"""Age up to which what a sender has told still counts [s]: three periods of HEARTBEAT."""
REOPEN_S = 1.0
"""Pause before what was lost, or not there (a wire, a pacer, a broker, a station, a tracker), is
opened again [s]."""
SILENCE_S = 0.15
"""Silence of a vehicle after which it may not receive commands [s]: of its telemetry, or of its
acknowledgements, which are overdue by then. Messages at 10 Hz are never silent for so long unless
one is lost."""
UPLINK_LOST_S = 0.5
"""Delay of an acknowledgement beyond the usual round trip from which the uplink is lost [s]: the
operator is informed, and the vehicle descends."""
DISARM_S = 10.0
"""A vehicle on the ground must be disarmed within this time [s], as we ask for it or by mode LAND:
the autopilot must first detect the landing."""
LOOK_S = 0.01
"""Period at which a state is read that nobody announces [s]: a step of a hand-shake, an input, the
sign of life of a pacer."""
NUMBER_LIMIT = 1e30
"""Largest number in a command: a 32-bit float on the wire holds it."""


class Phase(StrEnum):
    """Phases of the dead man's switch: what may leave."""

    WAITING = "waiting"
    """Armed, and no command yet: nothing leaves."""
    FRESH = "fresh"
    """The newest command, until its deadline."""
    BRING_DOWN = "bring_down"
    """The part of its bring-down whose time it is."""
    OVER = "over"
    """Nothing that lifts, until a new arming."""


class Deadman:
    """Begins in ``OVER``. Times are on one clock, the commands' [s]."""

    def __init__(self) -> None:
        self.refused = 0
        """Commands that came too late, out of order, or after the switch had opened."""
        self.held = False
        """True from :meth:`hold` on, until the next arming."""
        self._over = True
        self.command: Command | None = None
        """The newest one, while it or its bring-down may leave; else None."""

    def arm(self) -> None:
        """A new arming by the operator: commands count again."""
        self._over = False
        self.held = False
        self.command = None

    def hold(self) -> None:
        """No newer command counts: the newest one runs out, and its bring-down follows."""
        if self.command is None:
            self._over = True
        self.held = True

    def stop(self) -> None:
        """Nothing that lifts from now on: killed, disarmed, or closed."""
        self._over = True
        self.command = None

    def take(self, command: Command, now_s: float, seen_s: float | None = None) -> bool:
        """Take the newest command; False where it does not count, and then it changes nothing.

        Whoever looks for commands only once a frame says for which instant it made the last one,
        ``seen_s``: the switch has opened if it had by then. One that opened since has moved nothing
        yet, and the command may come in time.

        Raises:
            LinkMisuse: a number in it is not finite, its deadline is too far away, or its
                bring-down lasts too long.
        """
        _check(command, now_s)
        newest, opens = self.command, self.phase(now_s if seen_s is None else seen_s)
        if self.held or opens not in (Phase.WAITING, Phase.FRESH) or now_s > command.deadline_s:
            self.refused += 1
            return False
        if newest is not None and command.pose_time_s < newest.pose_time_s:
            self.refused += 1
            return False
        self.command = command
        return True

    def phase(self, now_s: float) -> Phase:
        """Phase at ``now_s``."""
        if self._over:
            return Phase.OVER
        if self.command is None:
            return Phase.WAITING
        if now_s <= self.command.deadline_s:
            return Phase.FRESH
        if self._segment(now_s) is not None:
            return Phase.BRING_DOWN
        self.stop()
        return Phase.OVER

    def changes_s(self, now_s: float) -> float:
        """The next instant after ``now_s`` after which something else leaves, if no command comes.

        Inf for never.
        """
        if self.phase(now_s) not in (Phase.FRESH, Phase.BRING_DOWN):
            return math.inf
        command = self.command
        assert command is not None, "only a command is fresh, or brings down"
        end = command.deadline_s
        for segment in command.bring_down:
            if end >= now_s:
                break
            end += segment.duration_s
        return end

    def at(self, now_s: float) -> Command | Segment | None:
        """Return the command or segment that leaves at ``now_s``.

        None where nothing that lifts may.
        """
        match self.phase(now_s):
            case Phase.FRESH:
                return self.command
            case Phase.BRING_DOWN:
                return self._segment(now_s)
            case _:
                return None

    def _segment(self, now_s: float) -> Segment | None:
        command = self.command
        assert command is not None, "a bring-down belongs to a command"
        end = command.deadline_s
        for segment in command.bring_down:
            end += segment.duration_s
            if now_s <= end:
                return segment
        return None


def _check(command: Command, now_s: float) -> None:
    numbers = [command.thrust_n, *command.rates_rad_s, command.pose_time_s, command.deadline_s]
    lasts = 0.0
    for part in command.bring_down:
        numbers += (part.thrust_n, *part.rates_rad_s, part.duration_s)
        lasts += part.duration_s
        if not part.duration_s >= 0.0:
            raise LinkMisuse(f"a part of a bring-down has no duration: {command}")
    # max() may lose a NaN, the sum does not.
    if not (max(map(abs, numbers)) <= NUMBER_LIMIT and math.isfinite(sum(numbers))):
        raise LinkMisuse(f"not finite: {command}")
    if lasts > BRING_DOWN_LIMIT_S + 1e-9:
        raise LinkMisuse(
            f"a bring-down lasts at most {BRING_DOWN_LIMIT_S:g} s, this one {lasts:g} s"
        )
    if command.deadline_s - now_s > DEADLINE_LIMIT_S:
        raise LinkMisuse(
            f"a deadline is at most {DEADLINE_LIMIT_S:g} s away, not "
            f"{command.deadline_s - now_s:g} s"
        )
