"""The findings as a person reads them."""

import textwrap
from collections.abc import Sequence

from groundstation.lab.doctor.advice import Finding, Weight, is_wrong

_MARKS = {"ok": "ok", "must": "MUST", "should": "SHOULD", "note": "note", "absent": "-"}
_ORDER = list(_MARKS)
WIDTH = 100


def report(title: str, findings: Sequence[Finding], command: str) -> str:
    """The table, the worst first, each that is not right with its reason and the ``command`` that mends it."""
    worst_first = ("must", "should", "ok", "note", "absent")
    lines = [title, "", f"{'':8}{'parameter':17}{'value':>9}  accepted"]
    for finding in sorted(findings, key=lambda f: worst_first.index(f.verdict)):
        value = "-" if finding.value is None else f"{finding.value:g}"
        lines += _wrapped(f"{_MARKS[finding.verdict]:8}{finding.name:17}{value:>9}  ", finding.accepted)
        if finding.verdict in (Weight.MUST, Weight.SHOULD, Weight.NOTE):
            lines += _wrapped(" " * 12, finding.why)
        if finding.recommended is not None:
            lines.append(f"{'':12}set it to {finding.recommended:g}: {command} --fix {finding.name}")
            if finding.reboot:
                lines.append(f"{'':12}(counts after the autopilot was restarted)")
    lines += ["", _summary(findings)]
    return "\n".join(lines)


def _wrapped(begin: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=begin, subsequent_indent=" " * max(len(begin), 12))


def _summary(findings: Sequence[Finding]) -> str:
    counts = {verdict: sum(f.verdict == verdict for f in findings) for verdict in _ORDER}
    absent = f", {counts['absent']} not in this firmware" if counts["absent"] else ""
    if not is_wrong(findings):
        return f"Nothing to change: {counts['ok']} ok, {counts['note']} to be read{absent}."
    return f"{counts['must']} must and {counts['should']} should be changed; {counts['ok']} ok{absent}."
