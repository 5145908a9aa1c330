"""Text from outside (an autopilot, a tracker, a broker, a recording), made fit for a terminal.

Sans-IO.
"""

REPLACEMENT = "·"
"""Character in the place of each one that is not printed."""


def printable(text: str, keep: str = "") -> str:
    """Replace every unprintable character of ``text`` by a dot; those in ``keep`` stay.

    Control characters (C0, DEL, C1) move the cursor, rename the window or end a line; marks of
    direction reverse words; line and paragraph separators forge a line of a log. Unprintable are
    Unicode's categories C and Z without the space.
    """
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() or each in keep else REPLACEMENT for each in text)
