"""At which pace a recording is played: as it was recorded, faster or slower, or as fast as it can be taken.

The file of a recorded source, read whole.
"""

import asyncio
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, TypeVar

import msgspec

from groundstation.core.messages import SourceError
from groundstation.runtime import sleep_until

T = TypeVar("T")

Speed: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | Literal["max"]
"""1 is the pace of the recording, 2 twice as fast; ``max`` waits for nothing."""
BREATH = 100
"""At full speed, others on the event loop get a turn after so many."""


async def play(items: Iterable[tuple[float, T]], speed: Speed, take: Callable[[T, float], None]) -> None:
    """Call ``take(item, when_s)`` for each (recorded time [s], item), in order.

    ``when_s`` is the item's time on the event loop's clock at the pace of the recording [s], whatever the speed: so
    speeds and rates come out as they were; played faster, items come before their time.
    """
    begun_s = asyncio.get_running_loop().time()
    first_s: float | None = None
    for count, (time_s, item) in enumerate(items):
        if first_s is None:
            first_s = time_s
        after_s = time_s - first_s
        if speed != "max":
            await sleep_until(begun_s + after_s / speed)
        elif count % BREATH == 0:
            await asyncio.sleep(0)
        take(item, begun_s + after_s)


_MCAP = b"\x89MCAP0\r\n"
"""How a recording of our own begins."""


def contents(path: Path) -> bytes:
    """All of the file ``path``, as ``pose.path`` names it.

    Raises:
        SourceError: it can't be read, or it is a recording that has to be exported first.
    """
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a path that no system takes
        raise SourceError(f"pose.path: cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if data.startswith(_MCAP):
        raise SourceError(
            f"pose.path: {path} is the recording of a flight: `groundstation export {path} --format poses` makes the "
            'file that pose.kind = "csv" plays'
        )
    return data


def no_poses(path: Path, dropped: Mapping[str, int], expected: str) -> SourceError:
    """What to raise for a file without poses: ``dropped`` counts what it holds instead, by reason."""
    found = ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items())) or "nothing at all"
    return SourceError(f"pose.path: {path} holds no poses (found: {found}); {expected}")
