"""The sender in docs/how-to/json-tracker.md, as it stands there, is understood."""

import asyncio
import math
import re
import sys
from pathlib import Path

import pytest

from groundstation.core.messages import Pose
from groundstation.pose.sources import JsonConfig
from links.io import parse_address
from tests.loops import free_address

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "json-tracker.md"


def test_the_documents_sender_is_understood() -> None:
    async def main() -> None:
        address = await free_address()
        source = JsonConfig(listen=address).build()
        poses: list[Pose] = []
        await source.start(poses.append)
        (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)
        assert len(code.strip().splitlines()) <= 16
        code = code.replace("51002", str(parse_address(address)[1])).replace("< 2.0", "< 0.5")
        sender = await asyncio.create_subprocess_exec(sys.executable, "-c", code)
        assert await sender.wait() == 0
        await asyncio.sleep(0.1)
        await source.close()
        assert len(poses) > 5
        assert source.status.dropped == {}
        for pose in poses:
            x, y, z = pose.position_ned
            assert math.hypot(x, y) == pytest.approx(1.0)
            assert z == -1.0

    asyncio.run(main())
