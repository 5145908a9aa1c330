"""What is beside a vehicle before it is armed, as checks: other flights here, other bodies, and its operator's hand."""

import math
from collections.abc import Callable, Sequence

from groundstation.core.messages.bodies import Others
from groundstation.core.messages.verdict import Check, Verdict
from groundstation.core.safety.takeoff import Standing
from groundstation.flight.hold_to_run.hold import Hold
from groundstation.runtime.place import socket_path
from groundstation.runtime.register import Running
from groundstation.settings.settings import Config, LinkConfig
from links.bridge.link import BridgeLinkConfig
from links.mavlink.protocol.config import MavlinkLinkConfig

SEEN_S = 0.5
"""A body that was not seen for so long may be anywhere [s]."""


class Company:
    """One flight's. Times are on the event loop's clock [s]."""

    def __init__(
        self, config: Config, bodies: Others | None, running: Callable[[], Sequence[Running]], hold: Hold | None
    ) -> None:
        """``bodies`` are all that the source shows, ``running`` what else flies from here, ``hold`` the operator's."""
        self._config = config
        self._bodies = bodies
        self._running = running
        self._hold = hold

    def __call__(self, standing: Standing, now_s: float, *, arming: bool = False) -> list[Check]:
        """The checks, as things are now; what the operator must hold need not be held before ``arming``."""
        return [self._names(), self._bodies_near(standing, now_s), self._hand(Verdict.FAIL if arming else Verdict.WARN)]

    def leave(self) -> None:
        """It takes off: bodies that nobody looks for cost no time any more."""
        if self._bodies is not None:
            self._bodies.every = False

    def _names(self) -> Check:
        """Whether another flight of this machine has the same body, commands the same vehicle, or has its name."""
        own, name = entry_of(self._config, "", 0), "other flights"
        bad, odd = list[str](), list[str]()
        for one in self._running():
            who = f"{one.command} {one.vehicle} (process {one.pid})"
            if own.link == one.link:
                bad.append(f"{who} commands {one.link} as well: stop one of them")
            elif own.body and own.body == one.body:
                of = f"{who} follows the body {one.body!r} as well"
                told = odd if own.poses != one.poses else bad
                told.append(f"{of}: two vehicles can't be one body, so one of them would fly by the other's poses")
            elif own.vehicle == one.vehicle:
                odd.append(f"{who} has the same name: whoever arms or lands by name may mean the other")
        verdict = Verdict.FAIL if bad else Verdict.WARN if odd else Verdict.PASS
        return Check(name, verdict, "; ".join(bad + odd) or "none of this machine has its name, body or link")

    def _bodies_near(self, standing: Standing, now_s: float) -> Check:
        """Whether another body is where this vehicle is."""
        name, size = "bodies near", self._config.vehicle.size_m
        if self._bodies is None or not standing.poses:
            return Check(name, Verdict.OFF, "the source shows no other bodies")
        place, near = standing.place_ned, list[tuple[float, str]]()
        for body in self._bodies.bodies:
            sight = self._bodies.seen(body)
            if sight is not None and now_s - sight.time_s < SEEN_S:
                near.append((math.dist(place, sight.position_ned), body))
        if not near:
            return Check(name, Verdict.PASS, "no other body is seen")
        distance, body = min(near)
        says = f"{body!r} is {distance:.2f} m from {self._config.body!r}"
        if distance >= size:
            return Check(name, Verdict.PASS, f"{says}, the nearest")
        more = f"less than vehicle.size_m ({size:g} m): move it away, or find out which name is whose"
        return Check(name, Verdict.FAIL, f"{says}, {more}")

    def _hand(self, otherwise: Verdict) -> Check:
        """Whether the operator holds what must be held."""
        name, hold = "operator's hold", self._hold
        if hold is None:
            return Check(name, Verdict.OFF, "operator.hold names nothing")
        if hold.obstacle:
            return Check(name, otherwise, f"{hold.obstacle}: {hold.advice}")
        return Check(name, Verdict.PASS, hold.advice)


def body_of(config: Config) -> str:
    """The vehicle's object in the capture system, as others of this machine can compare it; empty where it has none."""
    number = getattr(config.pose, "id", None)
    return config.body if number is None else f"id {number}"


def entry_of(config: Config, command: str, pid: int) -> Running:
    """What the register tells of a flight with this configuration."""
    pose = config.pose
    where = getattr(pose, "listen", None) or getattr(pose, "server", None) or ""
    return Running(
        pid=pid,
        command=command,
        vehicle=config.vehicle.name,
        socket=str(socket_path(config.status, config.vehicle.name).absolute()),
        body=body_of(config),
        poses=f"{pose.__struct_config__.tag} {where}",
        link=link_of(config.link),
    )


def link_of(link: LinkConfig) -> str:
    """Where the commands of ``link`` go."""
    if isinstance(link, MavlinkLinkConfig):
        where = f"{link.address} system {link.target_system}"
    else:
        where = link.remote if isinstance(link, BridgeLinkConfig) else link.port
    return f"{link.__struct_config__.tag} {where}"
