"""Table of the sentences that an operator can read: id, severity, sentence with named numbers, remedy. Sans-IO.

Code names the id and gives the numbers: ``notice("pose.late", age_ms=312.0, limit_ms=250.0)``.
A sentence states the fact, then the number and its limit; the remedy says what to do.
"""

import msgspec

from groundstation.core.messages.snapshot import Severity


class NoticeTemplate(msgspec.Struct, frozen=True):
    """One sentence for the operator, with named places for numbers (``str.format``)."""

    id: str
    """Name of the sentence in recordings and over MQTT: ``room.fact``."""
    sentence: str
    """The fact, its number and its limit."""
    remedy: str = ""
    """What to do; empty where nothing is to be done."""
    severity: Severity = Severity.INFO
    """Importance for the operator."""

    def format(self, **values: object) -> str:
        """Return the sentence and its remedy, filled with ``values``.

        Raises:
            KeyError: the sentence names a value that is missing.
        """
        sentence = self.sentence.format(**values)
        return f"{sentence}: {self.remedy.format(**values)}" if self.remedy else sentence


_TABLE: tuple[NoticeTemplate, ...] = (
    NoticeTemplate(
        "import.no_head",
        "no head line found: none of the first {rows} lines has a column {names}",
        "check time in the mapping; where the file has no head, write head_rows = 0 in [csv], and columns by number: "
        '"1" is the first{hint}',
    ),
    NoticeTemplate(
        "import.same_names",
        "several columns are called {name}",
        "where the lines above tell them apart, say how many lines the head has, head_rows in [csv]{hint}",
    ),
    NoticeTemplate(
        "import.no_body",
        "it holds no rigid body with position and rotation (found: {found})",
        "export rigid bodies from the tracker's program",
    ),
    NoticeTemplate("import.stated", "{key} is {found}, expected {wanted}", "export the file anew"),
    NoticeTemplate("import.bodies", "it holds {count} bodies, {names}", "name the vehicle, --body NAME"),
    NoticeTemplate(
        "campaign.kernel", "--kernel has no effect, because numpy computes all flights of a campaign", "leave it out"
    ),
    NoticeTemplate("pose.dropping", "poses are dropped: {why}"),
    NoticeTemplate(
        "pose.unsteady_clock",
        "the tracker's clock stepped {count} times within {within_s:g} s, so its stamps do not tell how old a pose is",
        "in flight, land; then find out what sets the sender's clock",
        Severity.WARNING,
    ),
    NoticeTemplate("pose.steady_clock", "the tracker's clock is steady again"),
    NoticeTemplate(
        "pose.stamp_rate",
        "the time stamps of the poses run {factor} times too {way}, limit {limit:g}",
        "{field} is expected in {unit}{looks_like}",
        Severity.WARNING,
    ),
    NoticeTemplate("pose.none", "no poses: {why}"),
    NoticeTemplate(
        "tui.multiplexer",
        "{taker} takes some keys itself, as delivered Ctrl-A (screen) or Ctrl-B (tmux)",
        "where a key does nothing, press the second one, which the footer names",
        Severity.WARNING,
    ),
)

NOTICES: dict[str, NoticeTemplate] = {template.id: template for template in _TABLE}
"""Every sentence by its id."""


def notice(id: str, **values: object) -> str:
    """Return the sentence ``id`` of the table, filled with ``values``.

    Raises:
        KeyError: the table has no such sentence, or the sentence names a value that is missing.
    """
    return NOTICES[id].format(**values)
