"""What comes of a pre-flight check: the verdict, and a sentence. Sans-IO."""

from enum import StrEnum

import msgspec


class Verdict(StrEnum):
    """What came of a check."""

    OFF = "OFF"
    PASS = "PASS"  # noqa: S105  # not a password
    WARN = "WARN"
    FAIL = "FAIL"


class Check(msgspec.Struct, frozen=True):
    """One check."""

    name: str
    """What was looked at."""
    verdict: Verdict
    """How it is."""
    says: str
    """A sentence: what was found, and what to do where it is not well."""
