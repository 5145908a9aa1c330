"""Steps: single things that an autopilot is asked for, each a state machine, and hand-shakes made of them. Sans-IO.

A step is polled with the time and answers with frames to send; it is shown every message that arrives; it ends
``done`` or with a ``failure``, which tells the operator what the autopilot said and what to do. A
:class:`Handshake` is steps one after the other.

Source: mavlink.io/en/services/command.html (COMMAND_LONG until its COMMAND_ACK); mavlink.io/en/messages/common.html (0
HEARTBEAT, 148 AUTOPILOT_VERSION, MAV_CMD_REQUEST_MESSAGE); the four bytes of flight_sw_version are major, minor, patch
and FIRMWARE_VERSION_TYPE, as PX4 and ArduPilot fill it in.

In which mode an autopilot is now: by itself it tells that only once a second. Sans-IO.

Source: mavlink.io/en/messages/common.html (0 HEARTBEAT, MAV_CMD_REQUEST_MESSAGE).

Motors off at once, asked for until the autopilot has said yes. Sans-IO.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.protocol.codec import (
    ARDUPILOT,
    ARM_DISARM,
    ARMED,
    FORCE,
    PX4,
    REQUEST_MESSAGE,
    MavlinkCodec,
    Message,
)
from links.mavlink.protocol.status import Words

ANSWER_S = 0.5
"""Without an answer for this long a request is repeated [s]."""
TRIES = 6
"""A request that is not answered this often is given up."""


class AutopilotAddress(NamedTuple):
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


class HandshakeStep(Protocol):
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

    def __init__(self, steps: Iterable[HandshakeStep]) -> None:
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

    def _await_more(self, next_s: float) -> None:
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


PATIENCE_S = 4.0
"""For how long a refusal that may pass is answered by asking again [s]."""
AGAIN_S = 1.0
"""Pause before asking again after such a refusal [s]."""
WORDS_S = 0.3
"""How long after a refusal the autopilot's explanation may still arrive [s]."""

ACCEPTED, TEMPORARILY_REJECTED, FAILED, IN_PROGRESS = 0, 1, 4, 5
_MAY_PASS = (TEMPORARILY_REJECTED, FAILED)


class Exchange(Repeated):
    """One COMMAND_LONG until its COMMAND_ACK."""

    def __init__(
        self,
        autopilot: AutopilotAddress,
        what: str,
        command: int,
        params: Sequence[float],
        hint: str,
        patience_s: float = PATIENCE_S,
        any_answer: bool = False,
    ) -> None:
        """Ask ``autopilot`` for ``command``; a refusal quotes its words and ends with ``hint``: what to do.

        A refusal that may pass is final after ``patience_s`` [s]; with ``any_answer`` it is as good as a yes.
        """

        def frame(repetition: int) -> bytes:
            system, component = autopilot.system, autopilot.component
            return autopilot.codec.command(system, component, command, *params, confirmation=repetition)

        super().__init__(what, frame)
        self._autopilot = autopilot
        self._command = command
        self._hint = hint
        self._patience = patience_s
        self._any_answer = any_answer
        self._refused: tuple[int, float] | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self._refused is None:
            return super().poll(now_s)
        result, at_s = self._refused
        if now_s >= at_s + WORDS_S and self.failure is None:
            name, because = self._autopilot.name, self._autopilot.codec.result_name(result)
            reason = self._autopilot.words.complaints() or "it gave no reason"
            self.failure = LinkRejected(f"{name} refused to {self._what} ({because}): {reason}. {self._hint}")
        return []

    def hear(self, message: Message, now_s: float) -> None:
        """Take the answer, where ``message`` is one and answers us."""
        if message.get_type() != "COMMAND_ACK" or message.command != self._command or not self._sent:
            return
        if message.target_system not in (0, self._autopilot.codec.system_id):
            return
        result = message.result
        began_s = now_s if self._since_s is None else self._since_s
        if result == ACCEPTED or self._any_answer:
            self.done = True
        elif result == IN_PROGRESS:
            self._await_more(now_s + ANSWER_S * TRIES)
        elif result in _MAY_PASS and now_s < began_s + self._patience:
            self._await_more(now_s + AGAIN_S)
        else:
            self._refused = (result, now_s)


ASKED = 3
"""An autopilot that does not tell after so many questions keeps it to itself."""
KINDS = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: "release"}
"""FIRMWARE_VERSION_TYPE."""


class ReadVersion:
    """Ask for the firmware's version; one that it does not tell is no failure."""

    failure: LinkError | None = None

    def __init__(self, autopilot: AutopilotAddress) -> None:
        """What it told is in ``firmware`` when done."""
        self.done = False
        self.firmware = ""
        """Such as ``PX4 1.16.0 release 0a1b2c3d4e5f6071``; empty where it does not tell."""
        self._autopilot = autopilot
        self._asked = 0
        self._next_s = 0.0

    def poll(self, now_s: float) -> list[bytes]:
        """The question, where it is due."""
        if self.done or now_s < self._next_s:
            return []
        if self._asked == ASKED:
            self.done = True
            return []
        self._asked += 1
        self._next_s = now_s + ANSWER_S
        codec, system, component = self._autopilot.codec, self._autopilot.system, self._autopilot.component
        number = float(codec.message_number("AUTOPILOT_VERSION"))
        return [codec.command(system, component, REQUEST_MESSAGE, number, confirmation=self._asked - 1)]

    def hear(self, message: Message, now_s: float) -> None:
        """Take the version, or the answer that there is none."""
        name = message.get_type()
        if name == "AUTOPILOT_VERSION":
            self.firmware = f"{self._autopilot.name} {version(message)}"
            self.done = True
        elif name == "COMMAND_ACK" and message.command == REQUEST_MESSAGE and message.result != ACCEPTED:
            self.done = True


def version(message: Message) -> str:
    """The version that an AUTOPILOT_VERSION tells: number, kind, and the first bytes of the commit as they are."""
    number = int(message.flight_sw_version)
    major, minor, patch, kind = number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF, number & 0xFF
    commit = bytes(message.flight_custom_version).hex()
    return f"{major}.{minor}.{patch} {KINDS.get(kind, kind)} {commit}"


MODE_AGAIN_S, MODE_PATIENCE_S = 0.1, 1.5
"""An autopilot that does not tell is asked again after so long, and not at all after the second [s]."""


class AskMode:
    """Ask for HEARTBEAT, which tells the mode and comes only once a second by itself; done when one has been heard.

    One that refuses is waited for. Its answer is waited for, too: a HEARTBEAT of before the question may be under way.
    """

    def __init__(self, autopilot: AutopilotAddress) -> None:
        """Nothing is asked yet."""
        self.failure: LinkError | None = None
        self._autopilot = autopilot
        self._heard = self._answered = False
        self._asked = 0
        self._next_s = self._until_s = -math.inf

    @property
    def done(self) -> bool:
        """True when it has told."""
        return self._heard and self._answered

    def poll(self, now_s: float) -> list[bytes]:
        """The question, where it is due."""
        if self._asked == 0:
            self._until_s = now_s + MODE_PATIENCE_S
        if self.done or now_s < self._next_s:
            return []
        if now_s >= self._until_s:
            self.failure = LinkLost(f"it did not tell its mode within {MODE_PATIENCE_S:g} s")
            return []
        self._next_s = now_s + MODE_AGAIN_S
        self._asked += 1
        return [make_mode_request(self._autopilot, self._asked - 1)]

    def hear(self, message: Message, now_s: float) -> None:
        """Take a heartbeat, or the answer."""
        name = message.get_type()
        self._heard = self._heard or name == "HEARTBEAT"
        self._answered = self._answered or (name == "COMMAND_ACK" and message.command == REQUEST_MESSAGE)


def make_mode_request(autopilot: AutopilotAddress, repetition: int = 0) -> bytes:
    """The frame that asks for HEARTBEAT."""
    codec, number = autopilot.codec, float(autopilot.codec.message_number("HEARTBEAT"))
    system, component = autopilot.system, autopilot.component
    return codec.command(system, component, REQUEST_MESSAGE, number, confirmation=min(repetition, 255))


KILL_AGAIN_S = 0.05
"""Time between two requests [s]."""
KILL_PATIENCE_S = 5.0
"""How long it is asked for [s]."""
CERTAIN = 2
"""So many acceptances end it: one alone may answer an order to arm that was under way."""
KILL_HINT = "Use the remote control's kill switch"


class Kill:
    """Disarm by force (COMMAND_LONG 400, second parameter 21196), which works in the air. A step (steps.py)."""

    def __init__(self, autopilot: AutopilotAddress) -> None:
        """Nothing leaves before the first poll."""
        self.done = False
        self.failure: LinkError | None = None
        self._autopilot = autopilot
        self._began_s: float | None = None
        self._next_s = 0.0
        self._sent = 0
        self._accepted = 0
        self._refused: int | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self._began_s is None:
            self._began_s = self._next_s = now_s
        if self.done or self.failure is not None or now_s < self._next_s:
            return []
        if now_s > self._began_s + KILL_PATIENCE_S:
            self._give_up()
            return []
        self._next_s = now_s + KILL_AGAIN_S
        self._sent += 1
        asked = self._autopilot
        again = min(self._sent - 1, 255)
        return [asked.codec.command(asked.system, asked.component, ARM_DISARM, 0.0, FORCE, confirmation=again)]

    def hear(self, message: Message, now_s: float) -> None:
        """Take the answer, where ``message`` is one."""
        if message.get_type() != "COMMAND_ACK" or message.command != ARM_DISARM or not self._sent:
            return
        if message.result == ACCEPTED:
            self._accepted += 1
            self.done = self._accepted >= CERTAIN
        else:
            self._refused = message.result

    def _give_up(self) -> None:
        if self._accepted:  # the rest of the answers got lost
            self.done = True
        elif self._refused is None:
            self.failure = LinkLost(f"no answer to “motors off”, sent {self._sent} times. {KILL_HINT}")
        else:
            name, because = self._autopilot.name, self._autopilot.codec.result_name(self._refused)
            reason = self._autopilot.words.complaints() or "it gave no reason"
            self.failure = LinkRejected(f"{name} refused to stop the motors ({because}): {reason}. {KILL_HINT}")
