"""Sentence for the operator: a row of a table of notices, filled with numbers. Sans-IO.

Code names the row by its id and gives the numbers; whoever shows, sends or records a sentence has
all three.
"""

import math
from collections.abc import Iterable
from enum import StrEnum
from typing import TypeAlias

import msgspec


class Severity(StrEnum):
    """Severity of a message to the operator."""

    INFO = "info"
    WARNING = "warning"


Numbers: TypeAlias = dict[str, float | str]
"""Values that a sentence was filled with, by their names."""


class Sentence(msgspec.Struct, frozen=True):
    """A text for the operator, with the id of its row in the table and its numbers."""

    id: str
    """Name of the row: ``room.fact``."""
    text: str
    numbers: Numbers = {}
    severity: Severity = Severity.INFO

    def __str__(self) -> str:
        return self.text

    def as_warning(self) -> "Sentence":
        """Return the same as a warning, which its text begins with."""
        return msgspec.structs.replace(
            self, text=f"warning: {self.text}", severity=Severity.WARNING
        )

    def as_lasting(self) -> "Sentence":
        """Return the same, said again because it lasts on."""
        return msgspec.structs.replace(self, text=f"{self.text}, still")


class NoticeTemplate(msgspec.Struct, frozen=True):
    """One sentence for the operator, with named places for numbers (``str.format``)."""

    id: str
    """Name of the sentence in recordings and over MQTT: ``room.fact``."""
    sentence: str
    """The fact, its number and its limit."""
    remedy: str = ""
    """Advice on what to do; empty where nothing is to be done."""
    severity: Severity = Severity.INFO
    """Importance for the operator."""

    def format(self, **values: object) -> Sentence:
        """Return the sentence and its remedy, filled with ``values``.

        Raises:
            KeyError: the sentence names a value that is missing.
        """
        fact = self.format_fact(**values)
        if not self.remedy:
            return fact
        return msgspec.structs.replace(fact, text=f"{fact.text}: {self.remedy.format(**values)}")

    def format_fact(self, **values: object) -> Sentence:
        """Return the sentence without its remedy, filled with ``values``.

        Raises:
            KeyError: the sentence names a value that is missing.
        """
        return Sentence(
            self.id, self.sentence.format(**values), collect_numbers(values), self.severity
        )


class NoticeTable:
    """Rows of a table of sentences, found by their ids."""

    def __init__(self, rows: Iterable[NoticeTemplate]) -> None:
        self._rows = {row.id: row for row in rows}

    def notice(self, id: str, **values: object) -> Sentence:
        """Return the sentence ``id`` of the table and its remedy, filled with ``values``.

        Raises:
            KeyError: the table has no such sentence, or the sentence names a value that is missing.
        """
        return self._rows[id].format(**values)


def as_warnings(*rows: NoticeTemplate) -> tuple[NoticeTemplate, ...]:
    """Return ``rows`` of a table as warnings."""
    return tuple(msgspec.structs.replace(row, severity=Severity.WARNING) for row in rows)


def collect_numbers(values: dict[str, object]) -> Numbers:
    """Return ``values`` as they are recorded.

    Of a sentence among them its id and its numbers are kept, too.
    """
    numbers = Numbers()
    for name, value in values.items():
        if isinstance(value, Sentence):
            numbers |= {**value.numbers, f"{name}_id": value.id}
        is_number = (
            isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        )
        numbers[name] = float(value) if is_number else str(value)  # type: ignore[arg-type]  # JSON knows no infinity
    return numbers
