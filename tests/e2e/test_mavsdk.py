"""A client that others wrote (MAVSDK) flies our simulated autopilot over real UDP: it is not only what we believe."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from tests.e2e.stations import free_udp_port

FLIGHT = """
import asyncio, sys
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import AttitudeRate, OffboardAsync

async def main():
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    await mavsdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
    vehicle = await mavsdk.first_autopilot(10)
    assert vehicle is not None, "nothing was discovered"
    action, offboard = ActionAsync(vehicle), OffboardAsync(vehicle)

    async def attempt(name, what):
        try:
            await what()
            print("did", name, flush=True)
        except Exception as error:
            print("refused", name, error, flush=True)

    await attempt("early-arm", action.arm)
    await offboard.set_attitude_rate(AttitudeRate(0, 0, 0, 0.57))
    await asyncio.sleep(1.3)
    await attempt("offboard", offboard.start)
    await attempt("arm", action.arm)
    await asyncio.sleep(float(sys.argv[2]))
    await offboard.set_attitude_rate(AttitudeRate(0, 20, 0, 0.55))  # deg/s, thrust 0..1
    await asyncio.sleep(0.5)
    await attempt("early-disarm", action.disarm)
    await attempt("land", action.land)
    for _ in range(60):
        await asyncio.sleep(0.1)
        try:
            await action.disarm()
        except Exception:
            continue
        print("did disarm", flush=True)
        break

asyncio.run(main())
"""


@contextmanager
def served(autopilot: str, port: int) -> Iterator["subprocess.Popen[str]"]:
    server = subprocess.Popen(
        [
            *(sys.executable, "-m", "sim", "serve", "--autopilot", autopilot, "--duration", "30"),
            *("--set", f"link.listen=127.0.0.1:{port}", "--set", f"pose.listen=127.0.0.1:{free_udp_port()}"),
            *("--set", "sim.floor_z_m=0.4"),
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert server.stdout is not None
        assert "serving" in server.stdout.readline()
        yield server
    finally:
        server.terminate()
        server.wait(60)
        assert server.stdout is not None
        server.stdout.close()


def test_an_independent_client_flies_the_simulated_autopilots() -> None:
    with ExitStack() as stack:  # both at once: a flight is mostly waiting
        flights = {}
        for autopilot, waits_s in (("px4", "0.5"), ("ardupilot", "2.6")):  # ArduCopter's rotors stand so long
            port = free_udp_port()
            stack.enter_context(served(autopilot, port))
            command = [sys.executable, "-c", FLIGHT, str(port), waits_s]
            flights[autopilot] = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        told = {autopilot: flight.communicate(timeout=60)[0] for autopilot, flight in flights.items()}
    for autopilot, text in told.items():
        said = [" ".join(line.split()[:2]) for line in text.splitlines() if line.startswith(("did ", "refused "))]
        assert said == [
            "refused early-arm",
            "did offboard",
            "did arm",
            "refused early-disarm",
            "did land",
            "did disarm",
        ], f"{autopilot}: {text}"
