"""Other senders in the network: second autopilots with the vehicle's number, and other systems.
Sans-IO.

MAVLink addresses a vehicle by its system id, which is 1 on every autopilot as it is sold: two
vehicles in one network, or on one radio, answer to the same commands. What tells them apart is the
hardware's own id in AUTOPILOT_VERSION (uid2, or uid where that is empty). Source:
mavlink.io/en/messages/common.html, 148 AUTOPILOT_VERSION.
"""

import math
from typing import Any

from links.core import NEWS_S
from links.mavlink.protocol.codec import MOST_SENDERS, Message
from links.mavlink.protocol.config import MavlinkLinkConfig
from links.text import link_notice


def hardware_id(version: Message) -> str:
    """The id of the autopilot's hardware in an AUTOPILOT_VERSION, in hexadecimal.

    Empty where it has none.
    """
    long_id = bytes(getattr(version, "uid2", ()))
    if any(long_id):
        return long_id.rstrip(b"\0").hex()
    return f"{version.uid:x}" if version.uid else ""


class HeardAddress:
    """One address that sends the vehicle's heartbeat."""

    def __init__(self) -> None:
        self.heard_s = 0.0
        self.has_answered = False
        self.ids: set[str] = set()


class TargetSenders:
    """The addresses that send with the vehicle's ids. Times are on the event loop's clock [s]."""

    def __init__(self, system: int, describe: Any) -> None:
        """``system`` is the vehicle's; ``describe(address)`` names an address for the operator."""
        self._system = system
        self._describe = describe
        self._senders: dict[Any, HeardAddress] = {}
        self._examined: tuple[Any, set[str]] | None = None
        """Address and hardware ids of the autopilot when it was examined."""

    def beat(self, address: Any, now_s: float) -> None:
        """A heartbeat of the vehicle came from ``address``.

        After a silence it may be another one's.
        """
        sender = self._senders.setdefault(address, HeardAddress())
        if sender.heard_s and now_s - sender.heard_s > NEWS_S:
            sender.ids.clear()
            sender.has_answered = False
        sender.heard_s = now_s
        if len(self._senders) > MOST_SENDERS + 1:
            del self._senders[min(self._senders, key=lambda one: self._senders[one].heard_s)]

    def forget(self, address: Any) -> None:
        """Another address is used now: what came from this one before shows no second autopilot."""
        self._senders.pop(address, None)

    def identify(self, address: Any, version: Message) -> None:
        """An AUTOPILOT_VERSION of the vehicle came from ``address``."""
        sender = self._senders.get(address)
        if sender is not None:
            sender.has_answered = True
            if found := hardware_id(version):
                sender.ids.add(found)

    def examine(self, used: Any) -> None:
        """The autopilot at ``used`` was found fit to be armed; another one was not."""
        self._examined = used, set(self._ids(used))

    def is_known(self, address: Any) -> bool:
        """Whether the autopilot at ``address`` has told who it is, or that it has no id."""
        sender = self._senders.get(address)
        return sender is not None and sender.has_answered

    def others(self, used: Any, now_s: float) -> list[Any]:
        """Addresses beside ``used`` from which the vehicle's heartbeat came of late."""
        return [
            address
            for address, sender in self._senders.items()
            if address != used and now_s - sender.heard_s <= NEWS_S
        ]

    def conflict(self, used: Any, now_s: float) -> str:
        """Why nobody knows which autopilot would obey what is sent to ``used``.

        Empty where one does.
        """
        used_ids = self._ids(used)
        if len(used_ids) > 1:
            return link_notice(
                "mavlink.two_on_one",
                count=len(used_ids),
                system=self._system,
                address=self._describe(used),
                ids=", ".join(sorted(used_ids)),
            ).text
        if self._examined is not None and self._is_replaced(used, *self._examined):
            address, checked = self._describe(used), self._describe(self._examined[0])
            return link_notice(
                "mavlink.replaced", address=address, hardware=self._tell_id(used), checked=checked
            ).text
        strangers = [other for other in self.others(used, now_s) if not self._is_same(used, other)]
        if strangers:
            return link_notice(
                "mavlink.two",
                count="two" if len(strangers) == 1 else "several",
                system=self._system,
                address=self._describe(used),
                hardware=self._tell_id(used),
                others=" and ".join(
                    f"one at {self._describe(other)}{self._tell_id(other)}" for other in strangers
                ),
            ).text
        return ""

    def second_path(self, used: Any, now_s: float) -> str:
        """That the same autopilot is heard by a second way; empty where it is not."""
        for other in self.others(used, now_s):
            if self._is_same(used, other):
                return link_notice(
                    "mavlink.two_paths", address=self._describe(used), other=self._describe(other)
                ).text
        return ""

    def _ids(self, address: Any) -> set[str]:
        sender = self._senders.get(address)
        return sender.ids if sender is not None else set()

    def _is_replaced(self, used: Any, examined: Any, examined_ids: set[str]) -> bool:
        used_ids = self._ids(used)
        if used == examined and not (used_ids and examined_ids):
            return False  # one of them told no id
        return used_ids != examined_ids or not used_ids

    def _is_same(self, one: Any, other: Any) -> bool:
        ids = self._ids(one)
        return len(ids) == 1 and ids == self._ids(other)

    def _tell_id(self, address: Any) -> str:
        ids = self._ids(address)
        return (
            f" (hardware id {', '.join(sorted(ids))})" if ids else " (which tells no hardware id)"
        )


VISION = (
    "VISION_POSITION_ESTIMATE", "GLOBAL_VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE",
    "ATT_POS_MOCAP", "ODOMETRY", "GPS_INPUT",
)  # fmt: skip
"""Messages that send an autopilot its position."""
SET_POINTS = (
    "SET_ATTITUDE_TARGET",
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT",
)
"""Messages that steer an autopilot."""


class OtherTraffic:
    """Messages of other systems: they may steer the vehicle, or send it positions."""

    def __init__(self, config: MavlinkLinkConfig) -> None:
        self._config = config
        self.tells_position = False
        """Whether another system was heard that sends an autopilot its position."""
        self.systems: dict[str, None] = {}
        """Other systems that were heard, by number and address: one may be the vehicle."""
        self._rival, self._rival_s = "", -math.inf

    def take_message(self, message: Message, address: str, now_s: float, *, ours: bool) -> None:
        """Take a message of another system at ``address``.

        ``ours``: whether we send set-points, so that one with our numbers may be an echo.
        """
        config, kind = self._config, message.get_type()
        system, component = message.get_srcSystem(), message.get_srcComponent()
        self.tells_position = self.tells_position or kind in VISION
        if kind == "HEARTBEAT" and len(self.systems) < MOST_SENDERS:
            self.systems[f"system {system}, component {component} at {address}"] = None
        if kind not in SET_POINTS or message.target_system not in (0, config.target_system):
            return
        if not ours or (system, component) != (config.system_id, config.component_id):
            says = link_notice(
                "mavlink.rival_sends", system=system, component=component, message=kind
            )
            self._rival, self._rival_s = says.text, now_s

    def rival(self, now_s: float) -> str:
        """Describe the other sender of set-points in the last ``NEWS_S``; empty without one."""
        return self._rival if now_s - self._rival_s < NEWS_S else ""
