"""Text for people: sentences with numbers, and foreign text fit for a terminal. Sans-IO."""

from links.text.link_notices import LINK_NOTICES, link_notice
from links.text.sentence import (
    NoticeTable,
    NoticeTemplate,
    Numbers,
    Sentence,
    Severity,
    as_warnings,
)
from links.text.terminal_text import printable
from links.text.units import to_cm, to_mm, to_ms, to_percent
