"""The simulated side of a flight: plant, cameras, and an autopilot or a radio receiver around one world and one seed.

Used in virtual time by ``groundstation-sim fly`` and in real time by ``groundstation-sim serve``.
"""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.settings import Config
from links.core import signal
from links.io import parse_address, read_key
from links.mavlink import MavlinkLinkConfig, StampFile
from links.mavlink.protocol import TICKS_PER_S, Signer
from sim.autopilots import AUTOPILOTS, AutopilotPeer, SimulatedAutopilot
from sim.radio import PtyWire, WirePort
from sim.trackers import Mocap, make_tracker
from sim.world import Horizon, Quadrotor, SimulatedVehicle, Wind, World, generator, rows, stream

if TYPE_CHECKING:
    from links.bridge import Bridge
    from sim.radio import RfPeer


class Stage:
    """Everything that is not the ground station. Every random draw comes from ``seed``, one stream a purpose."""

    def __init__(
        self,
        world: World,
        config: Config,
        seed: int,
        on_step: Callable[[float, Vec3], None] | None = None,
        *,
        autopilot: str = "px4",
        parameters: Mapping[str, float] | None = None,
        pty: PtyWire | None = None,
        alone: bool = True,
    ) -> None:
        """Set up a vehicle that is held in the air; ``config`` tells the addresses and formats to speak.

        ``autopilot`` is one of ``AUTOPILOTS``; ``parameters`` differ from its usual ones. A radio link ends at ``pty``,
        or else on the network in memory. Without ``alone``, cameras of its own are left out: others see it.

        Raises:
            KeyError: it has no such parameter.
            ValueError: the parameter can't have that value.
            ConfigError: the signing key can't be used.
        """
        self.world = world
        self.wind = Wind(world, rows(stream(seed, "turbulence").standard_normal, 3))
        self.plant = plant = Quadrotor(world, self.wind, on_step)
        estimate, wander = stream(seed, "estimate").standard_normal, stream(seed, "wander").standard_normal
        tracked = make_tracker(config.pose)
        horizon = Horizon(rows(stream(seed, "horizon").standard_normal, 3), world.gravity) if tracked else None
        self.vehicle = vehicle = SimulatedVehicle(plant, world, rows(estimate, 6), rows(wander, 3), horizon)
        luck = rows(stream(seed, "frame loss").random, 1)

        self.frame_loss = world.frame_loss
        """Share of the command frames that get lost; may be changed in flight [-]."""

        def lose() -> bool:
            # Hand-shakes repeat what gets lost; losses that count begin with the flight.
            return plant.released_s is not None and next(luck)[0] < self.frame_loss

        self.wires: dict[str, Any] = {}
        """What the link gets in the place of hardware; see :func:`groundstation.recording.assembly.make_flight`."""
        self._pty = pty
        self._mavlink: tuple[SimulatedAutopilot, AutopilotPeer] | None = None
        self._bridge: Bridge | None = None
        self.port = WirePort()
        """The wire to the module of a radio link on the network in memory."""
        self.radio: RfPeer | None = None
        """The other end of a radio link."""
        if isinstance(config.link, MavlinkLinkConfig):
            made = AUTOPILOTS[autopilot](
                vehicle,
                lose=lose,
                hover=signal(world.mass_kg * world.gravity / world.thrust_max_n, world.thrust_curve),
                parameters=parameters,
                own_estimate=world.own_estimate,
            )
            if config.link.signing_key_file is not None:
                made.codec.signer = _signer(Path(config.link.signing_key_file))
            # Where its own estimate serves as the poses, it comes as late as the cameras' would.
            delay = 0.0 if tracked is not None else world.pose_latency_s
            address = parse_address(config.link.address)
            peer = AutopilotPeer(made, address, delay_s=delay, hearing_s=world.command_delay_s)
            self._mavlink = made, peer
        else:
            # What only a radio needs is imported only where there is one.
            from sim.radio import RfPeer as Peer
            from sim.radio import RfReceiver, module, wires

            radio = module(config, world)
            self.radio = Peer(RfReceiver(vehicle, radio, lose=lose), radio, world.command_delay_s)
            if pty is None:
                self.wires, self._bridge = wires(config, radio, generator(seed, "nonces").bytes, self.port)
        self.mocap = Mocap(world, self.plant, seed, *tracked) if tracked is not None and alone else None

    @property
    def autopilot(self) -> SimulatedAutopilot:
        """The autopilot at the end of a MAVLink link."""
        assert self._mavlink is not None, "a radio link ends at a receiver"
        return self._mavlink[0]

    @property
    def peer(self) -> AutopilotPeer:
        """Its socket."""
        assert self._mavlink is not None, "a radio link ends at a receiver"
        return self._mavlink[1]

    async def run(self) -> None:
        """Let the world turn until cancelled."""
        async with asyncio.TaskGroup() as group:
            if self.radio is None:
                group.create_task(self.peer.run())
            elif self._pty is None:
                group.create_task(self.radio.run())
                if self._bridge is not None:
                    group.create_task(self._bridge.run())
            else:
                radio = self.radio
                self._pty.listen(lambda data: radio.datagram_received(data, None))
                group.create_task(radio.last())
            if self.mocap is not None:
                group.create_task(self.mocap.run())


def _signer(key_file: Path) -> Signer:
    """The autopilot's own use of the key that the ground station has."""
    loop = asyncio.get_running_loop()
    try:
        key, first, begun_s = read_key(key_file), StampFile(key_file).first(), loop.time()
    except ValueError as error:
        raise ConfigError("link.signing_key_file", str(error)) from None
    return Signer(key, lambda: first + int((loop.time() - begun_s) * TICKS_PER_S))
