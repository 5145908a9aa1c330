"""Drops: which dropped messages a person must see, before arming, in flight and afterwards. Sans-IO.

Every reason that a link counts is either here, with the share above which it is told, or needs nobody:
``other_system`` (stations, companions and cameras on the same network), ``unknown`` (messages of a newer
dialect), ``garbage`` (bytes of what is counted as a bad checksum, too), ``no_peer`` (nobody was heard
yet), ``bad_command`` (a bug of ours, which a test must find), and what a radio module says back, which no
flight rests on (``not_a_frame``, ``bad_checksum``, ``cut_short``, bytes). Poses are told in flight by
their source, for every reason.
"""

from collections.abc import Mapping
from typing import NamedTuple

from groundstation.core.messages.notices import notice
from groundstation.core.messages.pose import PoseStatus
from links.core import LinkStatus
from links.text import Sentence

LOSSY_SHARE = 0.01
"""Share of messages above which losses are told [-]: at 1 % one set-point or pose in 100 is missing."""
EACH = 0.0
"""Told from the first one on: on a link that is set up well it never happens."""
TOLD_AGAIN = 10.0
"""In flight a reason is told again when it counts this many times as much."""
FEW = 3
"""Fewer losses than this give no share."""


class DropLimit(NamedTuple):
    """When one reason is told."""

    share: float
    """Above this share of all messages [-]."""
    leaves: bool = False
    """Whether it counts messages of ours, not those that came."""


LINK_DROPS: Mapping[str, DropLimit] = {
    "truncated": DropLimit(LOSSY_SHARE),
    "bad_crc": DropLimit(LOSSY_SHARE),
    "unsigned": DropLimit(EACH),
    "bad_signature": DropLimit(EACH),
    "replayed": DropLimit(EACH),
    "other_address": DropLimit(EACH),
    "congested": DropLimit(LOSSY_SHARE, leaves=True),
    "full": DropLimit(LOSSY_SHARE, leaves=True),
    "undeliverable": DropLimit(LOSSY_SHARE, leaves=True),
    "port_stuck": DropLimit(LOSSY_SHARE, leaves=True),
    "port_lost": DropLimit(EACH),
    "bad_seal": DropLimit(EACH),
    "replayed_or_late": DropLimit(LOSSY_SHARE),
    "other_session": DropLimit(EACH),
}
"""Reason → when it is told; its sentence is ``link.REASON`` of the notices."""
USUAL_POSE_DROPS = frozenset(
    {"other_message", "other_system", "other_component", "unknown", "unknown_message", "no_server_info"}
)
"""Reasons of pose sources that are no loss: what else is said on the same port."""


class DropCount(NamedTuple):
    """One reason that a person must see."""

    reason: str
    number: int
    says: Sentence


def find_link_drops(
    link: LinkStatus, before: LinkStatus | None = None, *, has_second_path: bool = False
) -> list[DropCount]:
    """Find the drops of ``link`` to report since ``before`` (None: since it was opened).

    ``has_second_path``: the vehicle was heard by a second way before; a link that is closed tells no more of it.
    """
    counts = _count_since(link.dropped, {} if before is None else before.dropped)
    heard = link.received - (0 if before is None else before.received)
    sent = link.sent - (0 if before is None else before.sent)
    came = heard + sum(counts.get(reason, 0) for reason, limit in LINK_DROPS.items() if not limit.leaves)
    found = []
    for reason, limit in LINK_DROPS.items():
        count = counts.get(reason, 0)
        total = count + sent if limit.leaves else came
        if count and (limit.share == EACH or (count >= FEW and count > limit.share * total)):
            numbers = {"count": count, "total": total, "percent": 100.0 * count / total}
            is_heard_twice = has_second_path or bool(link.warning)
            is_own = reason == "other_address" and is_heard_twice and len(link.other_addresses) == 1
            name = "link.second_path" if is_own else f"link.{reason}"
            says = notice(name, addresses=", ".join(link.other_addresses), **numbers)
            found.append(DropCount(reason, count, says))
    return found


def find_pose_drops(source: PoseStatus) -> tuple[str, int, int] | None:
    """The reason for which most poses were dropped, its count, and the number of all; None where few were."""
    drops = {reason: count for reason, count in source.dropped.items() if reason not in USUAL_POSE_DROPS}
    total = source.accepted + sum(drops.values())
    reason = max(drops, key=lambda name: drops[name], default="")
    if not reason or drops[reason] < FEW or drops[reason] <= LOSSY_SHARE * total:
        return None
    return reason, drops[reason], total


class LinkDropWatch:
    """Tells of a link's drops in one flight: as they become too many, and again when they are tenfold."""

    def __init__(self, begin: LinkStatus) -> None:
        """Start at ``begin``: the pre-flight checks reported earlier drops."""
        self._begin = begin
        self._told: dict[str, int] = {}
        self._has_second_path = False

    def find_news(self, link: LinkStatus) -> list[Sentence]:
        """Sentences for what has become too much since the last look."""
        self._has_second_path = self._has_second_path or bool(link.warning)
        news = []
        for drop in find_link_drops(link, self._begin):
            if drop.number >= TOLD_AGAIN * self._told.get(drop.reason, 0):
                self._told[drop.reason] = drop.number
                news.append(drop.says)
        return news

    def summarize(self, link: LinkStatus) -> list[Sentence]:
        """Sentences for all of the flight, after it."""
        drops = find_link_drops(link, self._begin, has_second_path=self._has_second_path)
        return [drop.says for drop in drops]


def _count_since(now: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    return {reason: count - before.get(reason, 0) for reason, count in now.items()}
