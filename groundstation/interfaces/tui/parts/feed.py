"""The port of a dashboard: where what it shows comes from, and where what it asks for goes. Sans-IO."""

from collections.abc import AsyncIterator
from typing import Protocol

import msgspec

from groundstation.core.messages import Ask, Snapshot


class Hello(msgspec.Struct, frozen=True):
    """Whom the dashboard looks at."""

    vehicle: str
    origin: str
    """Where the data come from, for the operator: ``process 1234, groundstation 0.1`` or the name of a recording."""
    config: str
    """The configuration in force, as TOML; empty where it is not known."""


class Holder(msgspec.Struct, frozen=True):
    """Who holds control."""

    name: str
    """Empty: nobody."""
    yours: bool


class Trouble(msgspec.Struct, frozen=True):
    """Why nothing comes just now."""

    text: str


class Jump(msgspec.Struct, frozen=True):
    """What follows does not follow on what came before: a recording was wound on or back."""


News = Hello | Snapshot | Holder | Trouble | Jump


class Answer(msgspec.Struct, frozen=True):
    """What came of something that was asked for."""

    done: bool
    says: str
    """For the operator."""


class Feed(Protocol):
    """A running ground station, or a recording of one."""

    @property
    def live(self) -> bool:
        """True where something flies that can be asked for something."""
        ...

    def news(self) -> AsyncIterator[News]:
        """Everything that is to be shown, as it comes; it may end, but never raises. Iterated once."""
        ...

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Answer:
        """Ask for ``ask`` now or never: what can't be said at once is not said later. Arming names the ``vehicle``."""
        ...

    async def control(self, *, take: bool) -> Answer:
        """Take control, or give it back."""
        ...

    async def set_gain(self, key: str, value: float) -> Answer:
        """Change a gain in flight."""
        ...
