"""What a link tells its pacer, and what the pacer tells back. Sans-IO."""

from collections.abc import Awaitable, Callable
from typing import Protocol, TypeAlias

import msgspec

from links.core import Command
from links.rf.codecs import Manner, RfLinkConfig, Service


class Arm(msgspec.Struct, frozen=True, tag="arm"):
    """A new arming by the operator."""

    number: int
    """Of this arming, 1 for the first."""
    at_s: float
    """When it began [s]."""


class Give(msgspec.Struct, frozen=True, tag="give", gc=False):
    """The newest command. It goes a way of its own and may overtake the other orders."""

    arming: int
    """Number of the arming that it belongs to; under any other it is nothing."""
    command: Command


class Stop(msgspec.Struct, frozen=True, tag="stop"):
    """Disarm frames from the next frame on, until a new arming."""


class Serve(msgspec.Struct, frozen=True, tag="serve"):
    """Bind, or check the range, for a while; ignored unless disarmed."""

    service: Service
    duration_s: float
    """[s]"""


class End(msgspec.Struct, frozen=True, tag="end"):
    """End, but not before the newest command and its bring-down are over and ``linger_s`` [s] of disarm frames left."""

    linger_s: float


Order: TypeAlias = Arm | Give | Stop | Serve | End


class Held(msgspec.Struct, frozen=True, gc=False):
    """What a pacer holds as a frame leaves, for whoever must take over. Times are on the commands' clock [s]."""

    frame_s: float
    """When that frame leaves."""
    arming: int
    """Number of the newest arming."""
    obey_s: float
    """When that arming is over, and commands leave; infinite before the first."""
    command: Command | None
    """The newest, while it or its bring-down may leave."""
    linger_s: float | None
    """Of the :class:`End` that it was told; None before."""


class Report(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The pacer as it is now; times are on CLOCK_MONOTONIC in real time [s]."""

    now_s: float
    """When this was written."""
    frame_s: float
    """When some frame left or will leave: the others are whole periods away."""
    arming: int
    """Number of the newest arming that it knows."""
    over: bool
    """Whether nothing that lifts leaves any more."""
    frames: int
    """Frames that left."""
    lost: int
    """Frames that did not leave at their instant or not at all, the port being there."""
    repeated: int
    """Frames that said the same command once more, as no newer one had come in time."""
    refused: int
    """Commands that came too late or out of order."""
    port: str
    """Why the port can't be used; empty where it can."""
    received: int
    """Frames that came back from the module."""
    dropped: dict[str, int]
    """What was dropped or failed, by reason."""
    late_us: tuple[int, int, int]
    """Lateness of the frames, 50, 99 and 99.9 % [µs]."""
    late_octaves: tuple[int, ...]
    """Frames by lateness: entry k counts those late by less than 2**k µs and not by less than 2**(k-1)."""
    slept_s: float
    """How long its computer has slept since the newest arming [s]: nothing that lifts leaves, see suspend.py."""
    note: str
    """How it is scheduled, in words."""
    fifo: bool
    """Whether it runs with real-time priority."""
    deaf: bool = False
    """Whether commands of this arming have come in vain, and will: what it holds is played to its end, bring-down and
    all."""
    heir: str = ""
    """What became of the pacer, where its stand-by lets the frames go; empty where it does so itself."""
    alone: bool = False
    """Whether the pacer's stand-by has ended before it: nobody would let frames go in its place."""
    warning: str = ""
    """What is not as it should be with how it paces; empty where nothing is."""


class Pacer(Protocol):
    """The pacer as the link sees it: in another process, in the same loop, or behind a network."""

    @property
    def manner(self) -> Manner:
        """How it paces."""
        ...

    @property
    def why_mute(self) -> str:
        """What it means, in the operator's words, that no report comes."""
        ...

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; False where nobody takes it."""
        ...

    async def ended(self) -> None:
        """Wait until it has ended."""
        ...

    def forget(self) -> None:
        """Let go of it; it ends by itself as after :class:`End`, should it still live."""
        ...


Hear: TypeAlias = Callable[[Report | None], None]
"""Takes each report, and None at the pacer's end."""

OpenPacer: TypeAlias = Callable[[RfLinkConfig, float, Hear], Awaitable[Pacer]]
"""Start a pacer for a configuration and a full thrust [N]; its reports go to the callable, and None at its end."""
