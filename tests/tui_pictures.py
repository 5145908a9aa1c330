"""The pictures of the dashboard that tests compare with: ``python -m tests.tui_pictures`` draws
them anew.

With a recording, ``python -m tests.tui_pictures LOG.mcap SECONDS FILE.svg``, it draws the one of
the documents.
"""

import asyncio
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from textual.widgets import Input

from groundstation.interfaces.api import Control
from groundstation.interfaces.tui.app import Dashboard, open_playback
from groundstation.interfaces.tui.model import News
from groundstation.interfaces.tui.widgets import Banner
from tests.dashboards import Fixed, flown, keep_fresh, on_ground, until
from tests.sample_flight import sample

ID = re.compile(r"terminal-\d+-")
FAR_FONT = re.compile(r',\s*url\("https?://[^"]*"\) format\("[^"]*"\)')
FOLDER = Path(__file__).parent / "pictures"


class Pictured(NamedTuple):
    """What is drawn, on how large a terminal, in which colours, and after which keys."""

    news: Sequence[News]
    size: tuple[int, int]
    theme: str = "dark"
    keys: tuple[str, ...] = ()
    live: bool = True


YOURS = Control("tui 7", yours=True)
LOST = msgspec.structs.replace(sample(20.0).link, state="lost", dropped={"bad_checksum": 41})
LATE = {"late_us": (180, 950, 2100)}
PICTURES = {
    "fly": Pictured([*flown(20.0), YOURS], (80, 24)),
    "fly_wide_light": Pictured([*flown(20.0), YOURS], (132, 40), "light"),
    "ready": Pictured([*on_ground(), YOURS], (80, 24)),
    "arm": Pictured([*on_ground(), YOURS], (80, 24), keys=("a", "m", "q")),
    "link_lost_contrast": Pictured(
        flown(20.0, link=LOST, reason="nothing heard for 1.2 s"), (100, 30), "contrast"
    ),
    "control": Pictured(flown(20.0), (80, 24), keys=("2",)),
    "links": Pictured(flown(20.0, **LATE), (80, 24), "light", keys=("3",)),
    "recording": Pictured(flown(20.0), (80, 24), keys=("5",), live=False),
}


def draw(name: str) -> str:
    """One of the pictures, as the text of an SVG."""
    return asyncio.run(_draw(PICTURES[name]))


async def _draw(wanted: Pictured) -> str:
    feed = Fixed(wanted.news, live=wanted.live)
    dashboard = Dashboard(feed)
    dashboard.theme = wanted.theme
    async with dashboard.run_test(size=wanted.size) as pilot:
        await until(pilot, lambda: bool(dashboard.screen.query(Banner)))
        await keep_fresh(pilot, dashboard, feed)
        await pilot.press(*wanted.keys)
        await pilot.pause(0.5)
        for line in dashboard.screen.query(Input):
            line.cursor_blink = False
        dashboard.draw()
        await pilot.pause(0.1)
        return normal(dashboard.export_screenshot())


def normal(svg: str) -> str:
    """``svg`` without the numbers of one run, and without fonts that would be fetched."""
    return FAR_FONT.sub("", ID.sub("terminal-", svg))


async def draw_recording(log: Path, at_s: float) -> str:
    """The dashboard of a recording, ``at_s`` after its start."""
    playback = open_playback(log)
    playback.seek(at_s)
    playback.paused = True
    async with Dashboard(playback).run_test(size=(120, 36)) as pilot:
        await pilot.pause(1.2)
        return normal(pilot.app.export_screenshot())


if __name__ == "__main__" and len(sys.argv) > 1:
    _, recording, instant_s, picture = sys.argv
    svg = asyncio.run(draw_recording(Path(recording), float(instant_s)))
    Path(picture).write_text(svg, "utf-8")
elif __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for one in PICTURES:
        (FOLDER / f"{one}.svg").write_text(draw(one), "utf-8")
