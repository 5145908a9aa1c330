"""Text from outside (an autopilot, a tracker, a broker, a recording), made fit for a terminal. Sans-IO."""


def printable(text: str, keep: str = "") -> str:
    """``text`` with a dot in the place of all that is no visible letter, but for what is in ``keep``.

    Controls (C0, DEL, C1) move a cursor, rename a window or end a line; marks of direction turn words around; line and
    paragraph separators forge a line of a log. None of them gets through (Unicode's categories C and Z, but the space).
    """
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() or letter in keep else "·" for letter in text)
