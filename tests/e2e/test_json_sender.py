"""The senders of docs/how-to/extend.md are understood. ROS 2 has a stand-in."""

import asyncio
import math
import re
import sys
from pathlib import Path

import pytest

from groundstation.core.messages import Pose
from groundstation.pose.sources import JsonConfig
from links.io import parse_address
from tests.loops import free_address, in_real_time

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "extend.md"


ROS = """
import math, sys, time, types
from types import SimpleNamespace as N

def spin(node):
    begin = time.time()
    while (t := time.time() - begin) < 0.5:
        stamp = N(sec=int(begin + t), nanosec=int(1e9 * ((begin + t) % 1.0)))
        place = N(x=math.cos(t), y=math.sin(t), z=1.0)
        turn = N(w=math.cos(t / 2), x=0.0, y=0.0, z=math.sin(t / 2))
        node.callback(N(header=N(stamp=stamp), pose=N(position=place, orientation=turn)))
        time.sleep(0.02)

node = N()
node.create_subscription = lambda kind, topic, callback, qos: setattr(node, "callback", callback)
for name, holds in {
    "rclpy": {"init": lambda: None, "create_node": lambda name: node, "spin": spin},
    "rclpy.qos": {"qos_profile_sensor_data": 10},
    "geometry_msgs": {},
    "geometry_msgs.msg": {"PoseStamped": object},
}.items():
    sys.modules[name] = types.ModuleType(name)
    vars(sys.modules[name]).update(holds)
"""


@pytest.mark.parametrize(("number", "before"), [(0, ""), (1, ROS)], ids=["plain", "ROS 2"])
@in_real_time
async def test_the_documents_sender_is_understood(number: int, before: str) -> None:
    address = await free_address()
    source = JsonConfig(listen=address).build()
    poses: list[Pose] = []
    await source.start(poses.append)
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)[number]
    assert len([line for line in code.splitlines() if line.strip()]) <= 16
    code = code.replace("51002", str(parse_address(address)[1])).replace(
        "192.168.10.2", "127.0.0.1"
    )
    sender = await asyncio.create_subprocess_exec(
        sys.executable, "-c", before + code.replace("< 2.0", "< 0.5")
    )
    assert await sender.wait() == 0
    await asyncio.sleep(0.1)
    await source.close()
    assert len(poses) > 5
    assert source.status.dropped == {}
    for pose in poses:
        x, y, z = pose.position_ned
        assert math.hypot(x, y) == pytest.approx(1.0)
        assert z == -1.0
