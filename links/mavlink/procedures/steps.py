"""Single steps of asking an autopilot for something. Sans-IO state machines.

A step is polled with the time and answers with frames to send; it is shown every message that arrives; it ends
``done`` or with a ``failure``, which tells the operator what the autopilot said and what to do. A
:class:`Handshake` is steps one after the other.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.protocol import ARDUPILOT, ARMED, PX4, MavlinkCodec, Message, Words

ANSWER_S = 0.5
"""Without an answer for this long a request is repeated [s]."""
TRIES = 6
"""A request that is not answered this often is given up."""


class Autopilot(NamedTuple):
    """Who is asked, and how."""

    codec: MavlinkCodec
    """Packs the requests."""
    words: Words
    """What it says of late."""
    system: int
    """Its MAVLink system."""
    component: int
    """Its MAVLink component."""
    kind: int
    """Its HEARTBEAT.autopilot."""
    vehicle: int = 2
    """Its HEARTBEAT.type; 2 is a quadrotor."""

    @property
    def name(self) -> str:
        """What to call it."""
        return {PX4: "PX4", ARDUPILOT: "ArduPilot"}.get(self.kind, "the autopilot")


class Step(Protocol):
    """One thing to be reached."""

    @property
    def done(self) -> bool:
        """True when it is reached."""
        ...

    @property
    def failure(self) -> LinkError | None:
        """Why it will not be reached; None where that is open."""
        ...

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send at ``now_s``."""
        ...

    def hear(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""
        ...


class Handshake:
    """Steps one after the other; a step like them."""

    def __init__(self, steps: Iterable[Step]) -> None:
        """The first failure ends it."""
        self._steps = deque(steps)
        self.failure: LinkError | None = None

    @property
    def done(self) -> bool:
        """True when every step is."""
        return not self._steps

    @property
    def at_last_step(self) -> bool:
        """True from the moment on when the last request may have left."""
        return len(self._steps) <= 1

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send at ``now_s``."""
        while self._steps and self.failure is None:
            step = self._steps[0]
            frames = step.poll(now_s)
            self.failure = step.failure
            if not step.done:
                return frames
            self._steps.popleft()
        return []

    def hear(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""
        if self._steps:
            self._steps[0].hear(message, now_s)


class Wait:
    """Let time pass, while set-points stream."""

    failure: LinkError | None = None

    def __init__(self, duration_s: float) -> None:
        """From the first poll on."""
        self._duration = duration_s
        self._until: float | None = None
        self.done = False

    def poll(self, now_s: float) -> list[bytes]:
        """No frames."""
        if self._until is None:
            self._until = now_s + self._duration
        self.done = now_s >= self._until
        return []

    def hear(self, message: Message, now_s: float) -> None:
        """Nothing to learn."""


class Repeated:
    """A request that is sent again until something answers it."""

    def __init__(self, what: str, frame: Callable[[int], bytes]) -> None:
        """``frame(n)`` is the request's n-th repetition; ``what`` completes "to …"."""
        self.done = False
        self.failure: LinkError | None = None
        self._what = what
        self._frame = frame
        self._sent = 0
        self._unanswered = 0
        self._next_s = 0.0
        self._since_s: float | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self._since_s is None:
            self._since_s = now_s
        if self.done or self.failure is not None or now_s < self._next_s:
            return []
        if self._unanswered == TRIES:
            self.failure = LinkLost(
                f"no answer to the request to {self._what}, sent {TRIES} times: the autopilot is heard but does not "
                "hear us, or does not take commands from our system id; check the address it sends to"
            )
            return []
        self._next_s = now_s + ANSWER_S
        frame = self._frame(min(self._sent, 255))
        self._sent += 1
        self._unanswered += 1
        return [frame]

    def _answered(self, next_s: float) -> None:
        """There was an answer, but no end: ask again at ``next_s``."""
        self._unanswered = 0
        self._next_s = next_s


class Disarmed:
    """Wait for a HEARTBEAT that says that the motors are off."""

    def __init__(self, patience_s: float) -> None:
        """Fail after ``patience_s`` [s]."""
        self.done = False
        self.failure: LinkError | None = None
        self._patience = patience_s
        self._until: float | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """No frames."""
        if self._until is None:
            self._until = now_s + self._patience
        elif now_s >= self._until:
            self.failure = LinkRejected(
                f"still armed {self._patience:g} s after mode LAND: stop the motors with the remote control"
            )
        return []

    def hear(self, message: Message, now_s: float) -> None:
        """Take a heartbeat."""
        if message.get_type() == "HEARTBEAT" and not message.base_mode & ARMED:
            self.done = True
