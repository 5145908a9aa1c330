"""Stage: the simulated side of a flight: plant, cameras, and an autopilot or a radio receiver
around one seed.

A fleet has one for each vehicle, and one capture system that sees them all; its lab is the files
that a user would write. Used in virtual time by ``groundstation-sim fly`` and in real time by
``groundstation-sim serve``.
"""

import asyncio
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import tomli_w

from groundstation.config import ConfigError, dump, refuse_value
from groundstation.core.geometry import Vec3
from groundstation.machine import write_whole
from groundstation.pose.sources import vicon_codec
from groundstation.settings import Config
from links.bridge import BridgeLinkConfig
from links.core import signal
from links.io import parse_address
from links.mavlink import MavlinkLinkConfig, StampFile
from links.mavlink.protocol import Signer
from links.rf import CrsfLinkConfig, RfConfig, describe_pulses
from sim.autopilots import (
    AUTOPILOTS,
    Airworthy,
    AutopilotPeer,
    OnboardFirmware,
    OpenWire,
    SimulatedAutopilot,
    open_far_end,
    open_tcp,
    open_udp,
)
from sim.radio import (
    PtyWire,
    PulseReceiver,
    Receiver,
    RfPeer,
    RfReceiver,
    WirePort,
    bridge_to,
    module,
    wires,
)
from sim.scenarios import BETAFLIGHT
from sim.text import notice
from sim.trackers import Mocap, SeenVehicle, make_tracker
from sim.world import (
    AttitudeEstimator,
    Body,
    Quadrotor,
    SimulatedVehicle,
    Wind,
    World,
    generator,
    normals,
    rows,
)

if TYPE_CHECKING:
    from links.bridge import Bridge
    from sim.autopilots import FlightBoard


class Stage:
    """Simulated side of one vehicle. Random numbers come from ``seed``, one stream a purpose."""

    bridge_task: asyncio.Task[None] | None = None
    """Task of a radio's bridge; to cancel it is its operator's Ctrl-C."""
    radio: RfPeer | None = None
    """Other end of a radio link; None for MAVLink."""
    board: "FlightBoard | None" = None
    """Betaflight behind it; None where the receiver flies the vehicle itself."""
    onboard: OnboardFirmware | None = None
    """Real firmware at the end of a MAVLink link; None where a simulated autopilot is."""
    mocap: Mocap | None = None
    """Its own capture system; None where it has none."""
    _mavlink: tuple[SimulatedAutopilot, AutopilotPeer] | None = None
    _bridge: "Bridge | None" = None
    _telemetry_hz = 0.0

    def __init__(
        self,
        world: World,
        config: Config,
        seed: int,
        on_step: Callable[[float, Vec3], None] | None = None,
        *,
        autopilot: str | Airworthy = "px4",
        parameters: Mapping[str, float] | None = None,
        pty: PtyWire | None = None,
        alone: bool = True,
        standing: Sequence[tuple[str, Vec3]] = (),
    ) -> None:
        """Set up a vehicle that is held in the air; ``config`` has addresses and formats.

        ``autopilot`` is one of ``AUTOPILOTS``, Betaflight, or real firmware behind MAVLink over
        UDP; ``parameters`` differ from its usual ones. A radio link, or a serial one of MAVLink,
        ends at ``pty``, or else a radio's on the network in memory. Without ``alone``, cameras of
        its own are left out: others see it. ``standing``: see :class:`sim.trackers.trackers.Mocap`.

        Raises:
            KeyError: it has no such parameter.
            ValueError: the parameter can't have that value.
            ConfigError: the signing key can't be used.
        """
        self.world = world
        self.wind = Wind(world, normals(seed, "turbulence", 3))
        gyro = normals(seed, "gyro", 3) if world.plant == "rotors" else None
        self.plant = Quadrotor(world, self.wind, on_step, gyro)
        tracked = make_tracker(config.pose, world.tracker_yaw_deg)
        estimator = (
            AttitudeEstimator(normals(seed, "horizon", 3), world.gravity) if tracked else None
        )
        estimate, wander = normals(seed, "estimate", 6), normals(seed, "wander", 3)
        self.vehicle = SimulatedVehicle(self.plant, world, estimate, wander, estimator)
        self.frame_loss = world.frame_loss
        """Share of the command frames that get lost; may be changed in flight [-]."""
        self._luck = rows(generator(seed, "frame loss").random, 1)
        self.wires: dict[str, Any] = {}
        """Simulated hardware of the link; see :func:`groundstation.flight.make_flight`."""
        self._pty = pty
        self.port = WirePort()
        """The wire to the module of a radio link on the network in memory."""
        # Where its own estimate serves as the poses, it comes as late as the cameras' would.
        pose_delay_s = 0.0 if tracked is not None else world.pose_latency_s
        self._fit_link_end(config, seed, autopilot, parameters, pose_delay_s)
        if tracked is not None and alone:
            name, tracker = tracked
            self.mocap = Mocap(
                world, [SeenVehicle(name, self.plant, world, seed)], seed, tracker, standing
            )

    def _fit_link_end(
        self,
        config: Config,
        seed: int,
        autopilot: str | Airworthy,
        parameters: Mapping[str, float] | None,
        pose_delay_s: float,
    ) -> None:
        """Fit the end of the link: a receiver, real firmware, or a simulated autopilot."""
        link = config.link
        if not isinstance(link, MavlinkLinkConfig):
            assert isinstance(autopilot, str), "real firmware speaks MAVLink"
            self._fit_receiver(config, seed, betaflight=autopilot == BETAFLIGHT)
        elif isinstance(autopilot, str):
            self._fit_autopilot(link, autopilot, parameters, pose_delay_s)
        else:
            noise = normals(seed, "sensors of the firmware", 10)
            self.onboard = autopilot.fit(self.plant, parse_address(link.endpoint), noise)

    def _fit_autopilot(
        self,
        link: MavlinkLinkConfig,
        name: str,
        parameters: Mapping[str, float] | None,
        pose_delay_s: float,
    ) -> None:
        """Fit the simulated autopilot ``name`` at the end of ``link``.

        Its poses are ``pose_delay_s`` [s] late.
        """
        world = self.world
        autopilot = AUTOPILOTS[name](
            self.vehicle,
            lose=self._lose_frame,
            hover=signal(world.mass_kg * world.gravity / world.thrust_max_n, world.thrust_curve),
            parameters=parameters,
            own_estimate=world.own_estimate,
        )
        if link.signing_key_file is not None:
            autopilot.codec.signer = _signer(Path(link.signing_key_file))
        open_wire = _wire(link, self._pty)
        address = ("", 0) if open_wire is not None else parse_address(link.endpoint)
        peer = AutopilotPeer(
            autopilot,
            address,
            delay_s=pose_delay_s,
            hearing_s=world.command_delay_s,
            open_wire=open_wire,
        )
        self._mavlink = autopilot, peer

    def _fit_receiver(self, config: Config, seed: int, *, betaflight: bool) -> None:
        """Fit a radio receiver, which flies the vehicle itself or gives Betaflight its pulses."""
        world, radio = self.world, module(config, self.world, betaflight=betaflight)
        receiver: Receiver
        if betaflight:
            self.board = _start_betaflight(self.plant, world, radio, seed)
            receiver = PulseReceiver(self.board.hear, radio, lose=self._lose_frame)
        else:
            receiver = RfReceiver(self.vehicle, radio, lose=self._lose_frame)
        self.radio = RfPeer(receiver, radio, world.command_delay_s)
        self._telemetry_hz = world.telemetry_hz if isinstance(radio, CrsfLinkConfig) else 0.0
        if self._pty is None:
            self.wires, self._bridge = wires(
                config, radio, generator(seed, "nonces").bytes, self.port
            )
        elif isinstance(config.link, BridgeLinkConfig):
            self._bridge = bridge_to(config.link, radio, self._pty)

    def _lose_frame(self) -> bool:
        """Whether a command frame gets lost: hand-shakes repeat theirs, losses that count begin
        with the flight.
        """
        return self.plant.released_s is not None and next(self._luck)[0] < self.frame_loss

    @property
    def autopilot(self) -> SimulatedAutopilot:
        """The autopilot at the end of a MAVLink link."""
        assert self._mavlink is not None, "a radio link ends at a receiver"
        return self._mavlink[0]

    @property
    def peer(self) -> AutopilotPeer:
        """The autopilot's end of the wire."""
        assert self._mavlink is not None, "a radio link ends at a receiver"
        return self._mavlink[1]

    def offer_hand(self, seed: int) -> None:
        """Have a hand carry the vehicle by all moves for each line on standard input.

        Afterwards the vehicle is held at the last place.
        """
        from sim.world import make_hand

        loop, plant = asyncio.get_running_loop(), self.plant

        def take() -> None:
            if not os.read(sys.stdin.fileno(), 4096):  # a line of a terminal, or a part of one
                loop.remove_reader(sys.stdin.fileno())
                return
            print("the hand carries it", flush=True)
            began, now = loop.time(), plant.truth(loop.time())
            at = make_hand(seed, now.position_ned, now.attitude)

            def lead(time_s: float, thrust: float) -> Body:
                place, attitude, rates = at(time_s - began)
                return Body(place, (0.0, 0.0, 0.0), attitude, thrust, rates)

            plant.lead = lead
            plant.release(began)

        print("press Enter here for each `carry`: a hand makes its moves", flush=True)
        loop.add_reader(sys.stdin.fileno(), take)

    async def run(self) -> None:
        """Run all parts until cancelled."""
        async with asyncio.TaskGroup() as group:
            if self.onboard is not None:
                group.create_task(self.onboard.run())
            elif self.radio is None:
                group.create_task(self.peer.run())
            elif self._pty is None:
                group.create_task(self.radio.run())
            else:
                radio = self.radio
                self._pty.listen(lambda data: radio.datagram_received(data, None))
                group.create_task(radio.last())
            if self.radio is not None and self._telemetry_hz:
                say = self._pty.sendto if self._pty is not None else self.radio.answer
                group.create_task(
                    self.radio.tell(
                        say, lambda now: self.vehicle.estimate_attitude(now)[0], self._telemetry_hz
                    )
                )
            if self._bridge is not None:
                self.bridge_task = group.create_task(self._bridge.run())
            if self.board is not None:
                group.create_task(self.board.run())
            if self.mocap is not None:
                group.create_task(self.mocap.run())


def _start_betaflight(plant: Quadrotor, world: World, radio: RfConfig, seed: int) -> "FlightBoard":
    """Return Betaflight on ``plant``, with the settings for the module ``radio``."""
    from sim.autopilots import GAINS, FlightBoard, describe_settings  # only where there is one

    sticks = radio.map.roll, radio.map.pitch, radio.map.yaw
    settings = describe_settings(
        *describe_pulses(radio), [stick.full_rate_deg_s for stick in sticks]
    )
    gyro = normals(seed, "gyro of Betaflight", 3)
    return FlightBoard(plant, [*settings, *GAINS], gyro, world.rotors.gyro_noise_rad_s)


def _wire(link: MavlinkLinkConfig, pty: PtyWire | None) -> OpenWire | None:
    """Return the wire to an autopilot that does not speak first on UDP; None for one that does."""
    if link.serial is not None:
        assert pty is not None, "the caller has one for a serial port"
        return partial(open_far_end, port=pty)
    if link.tcp is not None:
        return partial(open_tcp, address=parse_address(link.tcp))
    return partial(open_udp, local=parse_address(link.remote)) if link.remote is not None else None


def _signer(key_file: Path) -> Signer:
    """Return the autopilot's signer, with the key of the ground station."""
    with refuse_value("link.signing_key_file"):
        return StampFile(key_file).make_signer(asyncio.get_running_loop().time)


SEEDS_APART = 1000
"""Difference between the seeds of two vehicles of one fleet [-]: more than a user flies in a
row."""

OnStep = Callable[[int, float, Vec3], None]
"""Takes the vehicle's number, the time [s] and the true place [m, NED] of every step of a plant."""


class FleetStage:
    """Simulated side of a fleet. Random numbers come from ``seed``, one stream a purpose."""

    def __init__(
        self,
        worlds: Sequence[World],
        labs: Sequence[Config],
        seed: int,
        on_step: OnStep,
        *,
        autopilot: str = "px4",
    ) -> None:
        """Set up a vehicle for each of ``worlds``, with addresses and formats of ``labs``.

        Raises:
            ConfigError: the poses come from no capture system that sees them all.
        """
        self.stages = [
            Stage(
                world,
                lab,
                seed + SEEDS_APART * number,
                partial(on_step, number),
                autopilot=autopilot,
                alone=False,
            )
            for number, (world, lab) in enumerate(zip(worlds, labs, strict=True))
        ]
        tracked = [make_tracker(lab.pose, worlds[0].tracker_yaw_deg) for lab in labs]
        names = [one[0] for one in tracked if one is not None]
        if tracked[0] is None or len(set(names)) < len(labs):
            raise ConfigError("--source", notice("sim.fleet_source"))
        vehicles = [
            SeenVehicle(name, stage.plant, stage.world, seed + SEEDS_APART * number)
            for number, (name, stage) in enumerate(zip(names, self.stages, strict=True))
        ]
        self.mocap = Mocap(worlds[0], vehicles, seed, tracked[0][1])

    async def run(self) -> None:
        """Run all parts until cancelled."""
        async with asyncio.TaskGroup() as group:
            for stage in self.stages:
                group.create_task(stage.run())
            group.create_task(self.mocap.run())


APART_M = 3.0
"""Distance between the figures of neighbours in the square grid [m]. Chosen: more than a figure's
width."""


def _move_in_grid(place: Vec3, number: int, count: int) -> Vec3:
    """Move a place [m, NED] to that of vehicle ``number`` in the square grid of ``count``."""
    across, (north, east, down) = math.ceil(math.sqrt(count)), place
    return north + APART_M * (number % across), east + APART_M * (number // across), down


def lay_out(
    folder: Path, world: World, config: Config, count: int, ports: Sequence[int]
) -> tuple[Path, list[World]]:
    """Write ``lab.toml`` and ``fleet.toml`` into ``folder``, for ``count`` vehicles like that of
    ``config``.

    Args:
        folder: of the two files.
        world: world of the first vehicle; the others' differ by the start.
        config: configuration of all; its trajectory is moved for each.
        count: number of vehicles.
        ports: free UDP ports: one for poses, one for the first of ``count`` copies of them, which
            follow one another, and one for each vehicle's link.

    Returns:
        The fleet file, and the world of each vehicle.

    Raises:
        ConfigError: the trajectory can't be moved, or link or count are none for a fleet.
    """
    most = vicon_codec.MOST_OBJECTS
    if not 1 <= count <= most:
        raise ConfigError("--vehicles", notice("value.count", least=1, most=most, count=count))
    if not config.link.has_autopilot:
        raise ConfigError("--link", notice("sim.fleet_link"))
    pose_port, relay_port, *link_ports = ports
    key = next((k for k in ("centre_ned", "position_ned") if hasattr(config.trajectory, k)), None)
    if key is None:
        raise ConfigError("trajectory.kind", notice("sim.fleet_trajectory"))
    pose: Any = config.pose
    if pose.address_key:
        where = {pose.address_key: f"127.0.0.1:{pose_port}"}
        config = msgspec.structs.replace(config, pose=msgspec.structs.replace(pose, **where))
    write_whole(folder / "lab.toml", dump(config))
    worlds, vehicles = [], list[dict[str, Any]]()
    for number in range(count):
        start_ned = _move_in_grid(world.start_ned, number, count)
        worlds.append(msgspec.structs.replace(world, start_ned=start_ned))
        vehicles.append(
            {
                "name": f"quad{number + 1}",
                "link": {"listen": f"127.0.0.1:{link_ports[number]}"},
                "trajectory": {key: _move_in_grid(getattr(config.trajectory, key), number, count)},
            }
        )
    file = folder / "fleet.toml"
    write_whole(
        file, tomli_w.dumps({"config": "lab.toml", "relay_port": relay_port, "vehicles": vehicles})
    )
    return file, worlds
