"""MAVSDK, a client that others wrote, flies our simulated autopilots over real UDP."""

import subprocess
import sys
from contextlib import ExitStack

from tests.e2e.stations import beside, free_udp_port, serving

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
EXPECTED = "refused early-arm, did offboard, did arm, refused early-disarm, did land, did disarm"


def test_an_independent_client_flies_the_simulated_autopilots() -> None:
    with ExitStack() as stack:  # both at once: a flight is mostly waiting
        flights = {}
        # ArduCopter's rotors stand so long.
        for autopilot, waits_s in (("px4", "0.5"), ("ardupilot", "2.6")):
            port, poses = free_udp_port(), f"pose.listen=127.0.0.1:{free_udp_port()}"
            wires = (f"link.listen=127.0.0.1:{port}", poses, "sim.floor_z_m=0.4")
            words = ("--autopilot", autopilot, "--duration", "30")
            says = stack.enter_context(serving(*words, *(f"--set={wire}" for wire in wires)))
            assert "serving" in says
            command = [sys.executable, "-c", FLIGHT, str(port), waits_s]
            flights[autopilot] = stack.enter_context(beside(command, stderr=subprocess.STDOUT))
        told = {
            autopilot: flight.communicate(timeout=60)[0] for autopilot, flight in flights.items()
        }
    for autopilot, text in told.items():
        told_by = [line.split()[:2] for line in text.splitlines()]
        said = [" ".join(words) for words in told_by if words[:1] in (["did"], ["refused"])]
        assert ", ".join(said) == EXPECTED, f"{autopilot}: {text}"
