"""The port every command link implements: what a command is, and how a link says that it failed.

A link turns a :class:`Command` into bytes on a wire. It knows no control, no mission and no screen.
"""

from collections.abc import Callable
from typing import ClassVar, Protocol, runtime_checkable

import msgspec


class Segment(msgspec.Struct, frozen=True, gc=False):
    """One part of a bring-down: thrust and body rates held for a while, whatever the vehicle does."""

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
    """What leaves after the deadline where no newer command came: at most 2 s in all, then nothing that lifts."""


class Attitude(msgspec.Struct, frozen=True, gc=False):
    """How the vehicle itself believes that it lies and turns."""

    time_s: float
    """When that was so, on the event loop's clock [s]."""
    attitude: tuple[float, float, float, float]
    """Unit quaternion w, x, y, z, body FRD to NED; its north is the vehicle's own."""
    rates_rad_s: tuple[float, float, float] | None
    """Body rates [rad/s], FRD; None where it tells none, as through a radio, which does not tell either when it was."""


class LinkError(Exception):
    """Anything that a link reports to the operator."""


class LinkLost(LinkError):
    """The other end went silent or the wire is gone; connecting again may help."""


class LinkRejected(LinkError):
    """The autopilot refused; the message holds its own words and what to do about them."""


class LinkMisuse(LinkError):
    """The caller broke the port's contract (a bug in this program, not of the operator)."""


class LinkStatus(msgspec.Struct, frozen=True):
    """What a link can tell about itself, for screens and telemetry."""

    state: str
    """One of ``closed``, ``connecting``, ``connected``, ``armed``, ``lost``."""
    sent: int
    """Commands that left."""
    expired: int
    """Commands withheld: their deadline had passed, or a bring-down had begun and nobody has armed since."""
    received: int
    """Messages received and understood."""
    dropped: dict[str, int]
    """Bytes or messages received and dropped, counted by reason."""
    text: str
    """The newest words of the other end (MAVLink STATUSTEXT), or an empty string."""
    phase: str = "over"
    """What may leave (see deadman.py): ``waiting``, ``fresh``, ``bring_down`` or ``over``."""
    rtt_s: float | None = None
    """Shortest of the newest round trips to the other end and back [s]; None where it is not known."""
    offset_s: float | None = None
    """The other end's clock less the event loop's [s]; None where it is not known."""
    taken: str = ""
    """The mode that somebody else has put the autopilot in since we armed it: nothing leaves any more; else empty."""
    battery_v: float | None = None
    """Voltage of the vehicle's battery [V]; None where it does not tell."""
    battery_share: float | None = None
    """Its charge [-]; None where it does not tell."""
    ready: bool | None = None
    """Whether the vehicle's own pre-arm checks pass; None where it does not tell."""
    mode: str = ""
    """The mode that the vehicle's autopilot was in when it was heard last; empty where it does not tell."""
    unfit: str = ""
    """Why :meth:`CommandLink.arm` would be refused, as :meth:`CommandLink.examine` found; empty where it found nothing.
    """
    firmware: str = ""
    """What the vehicle's autopilot runs, as it tells itself; empty where it does not tell."""
    slept_s: float = 0.0
    """How long the computer that sends has slept since the arming [s]: nothing more leaves, see suspend.py."""
    late_octaves: tuple[int, ...] = ()
    """Frames by how late they left, where a pacer lets them go and tells: entry k counts those late by less than 2**k
    µs and not by less than 2**(k-1); of all frames since it began."""
    period_s: float = 0.0
    """Time between two frames [s]; 0 where commands follow the poses, or where that is not known yet."""
    hears_vehicle: bool = True
    """Whether ``connected`` and ``armed`` are the vehicle's own words; False where nothing comes back from it, and they
    only say what was sent."""
    warning: str = ""
    """What an operator should know of how frames leave, before arming and in flight; empty where nothing is wrong."""
    unmet: str = ""
    """Why what was owed to the vehicle since its arming, the newest command or its bring-down, does not leave from
    here, and who has to act; empty where it leaves or has left."""


@runtime_checkable
class TellsMode(Protocol):
    """A link to an autopilot that somebody else may take over: in which mode it is then, it tells when asked."""

    def ask_mode(self) -> None:
        """Have it tell its mode now: what it does not do may be somebody else's doing."""
        ...


class LinkKind:
    """Beside the configuration of a link: what a flight asks of its kind."""

    __slots__ = ()
    has_autopilot: ClassVar[bool] = False
    """At the other end is an autopilot that tells of itself, not a receiver that is told alone."""


class CommandLink(Protocol):
    """How a command leaves. Every method runs on the event loop; none blocks it.

    Behind every link is a dead man's switch (deadman.py). From an arming on, whatever becomes of the caller, the link
    repeats the newest command until its deadline, plays the bring-down that it carries, and then lets nothing leave
    that lifts until somebody calls :meth:`arm` again.
    """

    @property
    def period_s(self) -> float:
        """Time between two commands [s]."""
        ...

    @property
    def follows_poses(self) -> bool:
        """True where a command may leave as soon as a pose has come; False where every ``period_s`` is its time."""
        ...

    @property
    def status(self) -> LinkStatus:
        """The link as it is now."""
        ...

    def watch_attitude(self, watch: Callable[[Attitude], None]) -> None:
        """Call ``watch`` with every attitude that the vehicle tells; to be asked for before :meth:`connect`.

        Never called where the vehicle tells none.
        """
        ...

    async def connect(self) -> None:
        """Open the wire and wait for the other end.

        Raises:
            LinkLost: nobody answered within the configured time.
        """
        ...

    async def examine(self) -> None:
        """Ask the other end what arming hangs on, as far as that can be asked without arming.

        ``status.unfit`` and ``status.firmware`` tell it from then on. Changes nothing there.

        Raises:
            LinkLost: it did not answer.
            LinkMisuse: the link is not connected.
        """
        ...

    async def arm(self, idle: Callable[[], Command]) -> None:
        """Stream what ``idle()`` returns, asked anew for each frame, until the vehicle is armed and obeys.

        Only for an operator's own arming: it is the one thing that lets commands leave again after a bring-down.

        Raises:
            LinkRejected: the autopilot refused, in its own words.
            LinkLost: it did not answer.
        """
        ...

    def send(self, command: Command) -> bool:
        """Send one command now, and repeat it until its deadline if no other comes.

        Returns False, and changes nothing, where its deadline has passed, where a bring-down has begun, or where
        nobody has armed.

        Raises:
            LinkMisuse: a number in the command is not finite, its deadline or its bring-down is too long, or the
                link is not connected.
        """
        ...

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""
        ...

    async def disarm(self) -> None:
        """Ask the vehicle to stop its motors.

        Raises:
            LinkRejected: the autopilot refused, in its own words.
            LinkLost: it did not answer.
        """
        ...

    async def kill(self) -> None:
        """Stop the motors at once, also in the air: nothing else leaves from the call on. Works in every state.

        Raises:
            LinkLost: the vehicle did not acknowledge.
            LinkRejected: it refused, in its own words.
        """
        ...

    async def close(self) -> None:
        """Release the wire. Nothing leaves afterwards.

        A link that has something to repeat or to bring down does that to its end first (at most the coast limit and
        2 s); only :meth:`kill` cuts it short.
        """
        ...
