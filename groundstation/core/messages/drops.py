"""Drops: dropped messages that are reported, before arming, in flight and afterwards. Sans-IO.

Every reason that a link counts is either here, with the share above which it is reported, or
harmless: ``other_system`` (stations, companions and cameras on the same network), ``unknown``
(messages of a newer dialect), ``garbage`` (bytes that are counted as a bad checksum, too),
``no_peer`` (no sender yet), ``bad_command`` (our own bug, which a test must find), and replies of a
radio module, which no flight depends on (``not_a_frame``, ``bad_checksum``, ``cut_short``, bytes).
Pose sources report every reason in flight themselves.
"""

from collections.abc import Mapping
from typing import NamedTuple

from groundstation.core.messages.notices import notice
from groundstation.core.messages.pose import PoseStatus
from links.core import LinkStatus
from links.text import Sentence, to_percent

LOSSY_SHARE = 0.01
"""Share of messages above which losses are reported [-]: at 1 % one set-point or pose in 100 is
missing."""
REPEAT_FACTOR = 10.0
"""Growth of a reason's count after which it is reported again in flight [-]. Chosen."""
FEW = 3
"""Least number of losses that are compared with a share [-]: one or two are chance."""


class DropLimit(NamedTuple):
    """Limit above which one reason is reported."""

    share: float = 0.0
    """Share of all messages [-]; 0: the first is reported, as a correctly set up link has none."""
    leaves: bool = False
    """Whether it counts sent messages, not received ones."""


LINK_DROPS: Mapping[str, DropLimit] = {
    "truncated": DropLimit(LOSSY_SHARE),
    "bad_crc": DropLimit(LOSSY_SHARE),
    "unsigned": DropLimit(),
    "bad_signature": DropLimit(),
    "replayed": DropLimit(),
    "other_address": DropLimit(),
    "congested": DropLimit(LOSSY_SHARE, leaves=True),
    "full": DropLimit(LOSSY_SHARE, leaves=True),
    "undeliverable": DropLimit(LOSSY_SHARE, leaves=True),
    "port_stuck": DropLimit(LOSSY_SHARE, leaves=True),
    "port_lost": DropLimit(),
    "bad_seal": DropLimit(),
    "replayed_or_late": DropLimit(LOSSY_SHARE),
    "other_session": DropLimit(),
}
"""Limit by reason; its sentence is ``link.REASON`` of the notices."""
USUAL_POSE_DROPS = frozenset(
    {
        "other_message",
        "other_system",
        "other_component",
        "unknown",
        "unknown_message",
        "no_server_info",
    }
)
"""Reasons of pose sources that are no loss: other messages on the same port."""


class DropCount(NamedTuple):
    """One reason that is reported."""

    reason: str
    number: int
    says: Sentence


def find_link_drops(
    link: LinkStatus, before: LinkStatus | None = None, *, has_second_path: bool = False
) -> list[DropCount]:
    """Find the drops of ``link`` to report since ``before`` (None: since it was opened).

    ``has_second_path``: whether the vehicle used a second path before; a closed link does not
        report that.
    """
    counts = _count_since(link.dropped, {} if before is None else before.dropped)
    received = link.received - (0 if before is None else before.received)
    sent = link.sent - (0 if before is None else before.sent)
    incoming = received + sum(
        counts.get(reason, 0) for reason, limit in LINK_DROPS.items() if not limit.leaves
    )
    found = []
    for reason, limit in LINK_DROPS.items():
        count = counts.get(reason, 0)
        total = count + sent if limit.leaves else incoming
        if count and (not limit.share or (count >= FEW and count > limit.share * total)):
            numbers = {"count": count, "total": total, "percent": to_percent(count / total)}
            is_second_path = has_second_path or bool(link.warning)
            is_own = reason == "other_address" and is_second_path and len(link.other_addresses) == 1
            name = "link.second_path" if is_own else f"link.{reason}"
            says = notice(name, addresses=", ".join(link.other_addresses), **numbers)
            found.append(DropCount(reason, count, says))
    return found


def find_pose_drops(source: PoseStatus) -> tuple[str, int, int] | None:
    """Return the reason of most drops, its count, and the number of all poses.

    None below the limit.
    """
    drops = {
        reason: count for reason, count in source.dropped.items() if reason not in USUAL_POSE_DROPS
    }
    total = source.accepted + sum(drops.values())
    reason = max(drops, key=lambda name: drops[name], default="")
    if not reason or drops[reason] < FEW or drops[reason] <= LOSSY_SHARE * total:
        return None
    return reason, drops[reason], total


class LinkDropWatch:
    """Reports of a link's drops in one flight: as they become too many, and again when they are
    tenfold.
    """

    def __init__(self, begin: LinkStatus) -> None:
        """Start at ``begin``: the pre-flight checks reported earlier drops."""
        self._begin = begin
        self._reported: dict[str, int] = {}
        self._has_second_path = False

    def find_news(self, link: LinkStatus) -> list[Sentence]:
        """Return the sentences of reasons that have become too many since the last call."""
        self._has_second_path = self._has_second_path or bool(link.warning)
        news = []
        for drop in find_link_drops(link, self._begin):
            if drop.number >= REPEAT_FACTOR * self._reported.get(drop.reason, 0):
                self._reported[drop.reason] = drop.number
                news.append(drop.says)
        return news

    def summarize(self, link: LinkStatus) -> list[Sentence]:
        """Return the sentences of the whole flight, after it."""
        drops = find_link_drops(link, self._begin, has_second_path=self._has_second_path)
        return [drop.says for drop in drops]


def _count_since(now: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    return {reason: count - before.get(reason, 0) for reason, count in now.items()}
