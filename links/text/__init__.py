"""Text from outside, made fit for a terminal. Sans-IO."""

from links.text.terminal_text import printable
