"""Snapshots of a made-up flight; ``python -m tests.sample_flight SOCKET [SECONDS]`` serves them."""

import asyncio
import math
import sys

from groundstation.core.geometry import Vec3
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.messages import (
    Ask,
    Certificate,
    Diagnostics,
    DisturbanceReading,
    Notice,
    Reply,
    Request,
    Sentence,
    Snapshot,
)
from groundstation.interfaces.api import Server
from groundstation.machine import Latest, StatusConfig
from links.core import LinkStatus


class Sampled:
    """In the place of a flight: remembers what was asked, and does all but to hold."""

    def __init__(self) -> None:
        self.asked: list[Request] = []
        self.gains: dict[str, float] = {}
        self.notes: list[str] = []

    def ask(self, request: Request) -> Reply:
        self.asked.append(request)
        if request.ask is Ask.HOLD:
            return Reply(False, "hold is not possible while landing")
        return Reply(True, f"{request.ask}: {request.why}")

    def set_gain(self, key: str, value: float) -> Reply:
        self.gains[key] = value
        return Reply(True, f"{key} moves to {value:g}")

    def say(self, sentence: Sentence) -> None:
        self.notes.append(sentence.text)


class Outspoken(Sampled):
    """Says what is asked, one word a line."""

    def ask(self, request: Request) -> Reply:
        print(request.ask, flush=True)
        return super().ask(request)


def sample(time_s: float, *, vehicle: str = "mqx", state: str = "tracking") -> Snapshot:
    """The made-up flight ``time_s`` after its start: a figure of eight with some error."""
    phase = 0.5 * time_s
    reference: Vec3 = (1.2 * math.sin(phase), 0.8 * math.sin(2.0 * phase), -1.0)
    fade = 0.02 + 0.6 * math.exp(-0.5 * time_s)
    error: Vec3 = (fade * math.cos(3.0 * time_s), fade * math.sin(2.0 * time_s), 0.3 * fade)
    x, y, z = (a + b for a, b in zip(reference, error, strict=True))
    zero: Vec3 = (0.0, 0.0, 0.0)
    return Snapshot(
        vehicle=vehicle,
        state=state,
        reason="following the trajectory",
        time_s=100.0 + time_s,
        flight_time_s=time_s,
        pose_id=int(50.0 * time_s),
        pose_age_s=0.012,
        pose_rate_hz=50.0,
        pose_latency_s=0.020,
        poses_dropped={"stale": 1, "wrong_object": 2},
        position_ned=(x, y, z),
        velocity_ned=(0.4, 0.2, 0.0),
        attitude=from_euler_zyx(0.05 * math.sin(time_s), -0.04, 0.3),
        reference_ned=reference,
        error_m=math.hypot(*error),
        rms_m=fade,
        thrust_n=0.80 + 0.1 * math.sin(time_s),
        thrust_max_n=1.37,
        rates_rad_s=(0.5 * math.sin(2.0 * time_s), -0.3, 0.1),
        saturated=False,
        diagnostics=Diagnostics(
            z1=error,
            z2=zero,
            z3=zero,
            u_star=zero,
            b_hat=(0.1, -0.05, 0.2),
            b_hat_dot=zero,
            disturbance=(0.11, -0.06, 0.19),
            v_terms=(0.01, 0.006, 0.004),
            w_terms=(0.02, 0.01, 0.01),
            v_known=0.02,
            w=0.03,
            certificate="paper",
        ),
        disturbance=DisturbanceReading(
            ned_m_s2=(0.1, -0.05, 0.2),
            wind_down_m_s2=0.18,
            wind_down_error_m_s2=0.13,
            thrust_scale=0.998,
            thrust_scale_error=0.013,
        ),
        link=LinkStatus(
            state="armed",
            sent=int(44.4 * time_s),
            expired=0,
            received=120,
            dropped={"bad_checksum": 1},
            text="Armed by us",
        ),
        certificate=Certificate(
            state="holds",
            bound="paper",
            v=0.021,
            excess=0.0,
            violated_fraction=0.0,
            suspended_fraction=0.0,
            b_hat_fraction=0.04,
        ),
        gains={"controller.k2": 2.0, "controller.k3": 4.0, "controller.kb": 1.0},
        events=(
            Notice(99.0, "ready", "link and poses are available", "state"),
            Notice(100.0, "tracking", "following the trajectory", "state"),
        ),
    )


async def serve(path: str, seconds: float, rate_hz: float) -> None:
    """Fly the made-up flight for so long [s], with its status socket at ``path``."""
    latest: Latest[Snapshot] = Latest()
    server = Server(StatusConfig(path=path, rate_hz=rate_hz), "mqx", latest, Outspoken())
    await server.open()
    publishing = asyncio.create_task(server.publish())
    loop = asyncio.get_running_loop()
    start = loop.time()
    while (now := loop.time() - start) < seconds:
        latest.put(sample(now))
        await asyncio.sleep(0.5 / rate_hz)
    publishing.cancel()
    server.close()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else math.inf, 5.0))
