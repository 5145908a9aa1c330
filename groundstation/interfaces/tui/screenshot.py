"""A picture of a dashboard, as SVG: drawn without a terminal, and the same every time."""

import re

from textual.app import AutopilotCallbackType
from textual.pilot import Pilot

from groundstation.interfaces.tui.app import Dashboard

SETTLE_S = 0.6
"""Long enough for a few drawings [s]."""
_ID = re.compile(r"terminal-\d+-")
_FAR_FONT = re.compile(r',\s*url\("https?://[^"]*"\) format\("[^"]*"\)')


def shoot(dashboard: Dashboard, size: tuple[int, int], keys: tuple[str, ...] = ()) -> str:
    """``dashboard`` on a terminal of so many columns and rows, after ``keys`` were pressed, as the text of an SVG."""
    shots: list[str] = []
    dashboard.run(headless=True, size=size, auto_pilot=_photographer(keys, shots))
    return shots[0]


def _photographer(keys: tuple[str, ...], shots: list[str]) -> AutopilotCallbackType:
    async def photograph(pilot: Pilot[object]) -> None:
        await pilot.pause(SETTLE_S)
        await pilot.press(*keys)
        await pilot.pause(SETTLE_S)
        shots.append(normal(pilot.app.export_screenshot()))
        pilot.app.exit()

    return photograph


def normal(svg: str) -> str:
    """``svg`` without the numbers that differ from run to run, and without fonts that would have to be fetched."""
    return _FAR_FONT.sub("", _ID.sub("terminal-", svg))
