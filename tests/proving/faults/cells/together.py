"""Cells that begin alike, flown together: one flight up to the moment, and from there a process for each fault.

Up to the instant at which it is struck, a flight of virtual time is the same for all faults that it is set up alike
for: the wait for poses, the take-off, the way onto the figure. So it is flown once, and each fault strikes a copy of
the process that has flown it; the rows are those of flights of their own. Whoever is copied has no other thread.
"""

import asyncio
import os
from collections.abc import Sequence

import msgspec

from tests.proving.faults.cells.cell import fly_cell
from tests.proving.faults.judge import Row


class _Struck(Exception):
    """All copies have flown on."""


class _Copies:
    """Processes that fly on from one instant, one after the other, each with its own fault."""

    def __init__(self, faults: Sequence[str]) -> None:
        self.rows: list[Row] = []
        """What they have found, in their order."""
        self.out: int | None = None
        """Where a copy tells what it has found; None in the process that is none."""
        self._faults = faults

    def split(self) -> str:
        """In each copy its fault.

        Raises:
            _Struck: in the process that is copied, when all have ended.
            RuntimeError: one of them has failed; what it died of.
        """
        loop = asyncio.get_running_loop()
        for fault in self._faults:
            far, near = os.pipe()
            number = os.fork()
            if number == 0:
                os.close(far)
                asyncio._set_running_loop(loop)  # it is told by the process's number
                self.out = near
                return fault
            os.close(near)
            with os.fdopen(far, "rb") as told:
                found = msgspec.msgpack.decode(told.read() or b"\xc0", type=Row | str | None)
            os.waitpid(number, 0)
            if not isinstance(found, Row):
                raise RuntimeError(f"{fault}: {found or 'its process was killed'}")
            self.rows.append(found)
        raise _Struck


def fly_together(
    faults: Sequence[str], state: str, *, seed: int, scenario: str, overrides: tuple[str, ...] = ()
) -> list[Row]:
    """The rows of ``faults`` in ``state``, which all have the same link, source and overrides."""
    copies = _Copies(faults)
    found: Row | str
    try:
        found = fly_cell(faults[0], state, seed=seed, scenario=scenario, overrides=overrides, split=copies.split)
    except _Struck:
        return copies.rows
    except BaseException as error:
        if copies.out is None:
            raise
        found = f"{type(error).__name__}: {error}"
    if copies.out is not None:  # a copy ends here: what comes next is its original's to do
        os.write(copies.out, msgspec.msgpack.encode(found))
        os._exit(0)
    assert isinstance(found, Row), "told by whoever has failed"
    return [msgspec.structs.replace(found, fault=fault) for fault in faults]  # never struck
