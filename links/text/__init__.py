"""Text for people: sentences with their numbers, and text from outside, made fit for a terminal. Sans-IO."""

from links.text.sentence import NoticeTemplate, Numbers, Sentence, Severity, as_warnings
from links.text.terminal_text import printable
