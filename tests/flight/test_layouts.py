"""examples/layouts: every curve that they show is in a recording."""

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from groundstation.analysis.viewers import FoxgloveScene
from tests.recordings import recorded

LAYOUTS = Path(__file__).parents[2] / "examples/layouts"


@cache
def curves() -> frozenset[str]:
    """Every value of every channel, by mcap's own reader: topic/field/part."""
    path, _, _ = recorded()
    found: set[str] = set()
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            found.update(_leaves(channel.topic, json.loads(message.data)))
    return frozenset(found)


def _leaves(name: str, value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(f"{name}/{key}", item)
    else:
        yield name


def foxglove() -> dict[str, Any]:
    layout: dict[str, Any] = json.loads((LAYOUTS / "foxglove.json").read_text("utf-8"))
    return layout


def foxglove_paths(value: Any) -> Iterator[str]:
    """Every message path in the layout."""
    if isinstance(value, dict):
        for key, item in value.items():
            if key == "value" and isinstance(item, str):
                yield item
            else:
                yield from foxglove_paths(item)
    elif isinstance(value, list):
        for item in value:
            yield from foxglove_paths(item)


def test_every_path_and_topic_of_the_foxglove_layout_is_in_the_file() -> None:
    panels = foxglove()["configById"]
    shown = {re.sub(r"\.", "/", path) for path in foxglove_paths(panels)}
    assert len(shown) > 25
    assert shown - curves() == set()
    topics = {name.split("/")[1] for name in curves()}
    named = {*panels["3D!room"]["topics"], panels["RosOut!log"]["topicToRender"]}
    drawn = {topic.strip("/") for topic in FoxgloveScene.topics}
    assert {topic.strip("/") for topic in named} - topics - drawn == set()
