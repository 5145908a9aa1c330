"""The whole configuration of a ground station: one TOML file, one section a struct in that thing's own file."""

from typing import Annotated, Literal, TypeAlias

import msgspec

from groundstation.core.control import ControllerConfig, Gains
from groundstation.core.safety import FenceConfig, GuardsConfig, LandingConfig, SeparationConfig, TakeoffConfig
from groundstation.core.trajectory import LemniscateConfig, TrajectoryConfig
from groundstation.core.vehicle import LimitsConfig, Vehicle
from groundstation.pose import GateConfig, PoseConfig, ShowsOthers
from groundstation.pose.sources import MavlinkPoseConfig, ViconConfig, VisionConfig
from groundstation.runtime import RecordingConfig, StatusConfig
from groundstation.settings.hold_to_run import OperatorConfig
from groundstation.settings.mqtt import MqttConfig
from links.bridge import BridgeLinkConfig
from links.core import full_thrust_n
from links.mavlink.protocol import ForwardConfig, MavlinkLinkConfig
from links.rf import RfConfig

HOVER_TOLERANCE = 0.02
"""Hover thrust is rounded where autopilots show it: so much may the full thrust by it fall short, as a share."""

LinkConfig: TypeAlias = MavlinkLinkConfig | RfConfig | BridgeLinkConfig
"""The configuration of one link, picked by its ``kind``; see ``links.make.LINKS``."""


class FlightConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a flight begins, rests on its poses, and ends."""

    start: Literal["floor", "air"] = "floor"
    """``floor``: take off, hold, then fly onto the trajectory. ``air``: only for a simulated vehicle that is held in
    the air until it obeys; it follows the trajectory at once."""
    duration_s: Annotated[float, msgspec.Meta(gt=0.0)] | None = None
    """Fly back and land after this time on the trajectory [s]; without it, only when told to."""
    coast_s: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 0.25
    """How long commands may rest on one pose [s]. After it comes the descent on the model (``guards.level_s``), where
    it took off from the floor, then the link's bring-down, and then nothing leaves."""
    pose_wait_s: Annotated[float, msgspec.Meta(gt=0.0)] = 5.0
    """How long to wait for the first pose [s]."""
    idle_thrust: Annotated[float, msgspec.Meta(ge=0.0, le=0.9)] = 0.0
    """Thrust streamed until the vehicle is armed, as a share of its weight [-]."""
    descent_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 0.4
    """Fastest speed of the landing [m/s]."""
    floor_z_m: float = 0.0
    """Where the vehicle's pose is when it stands on the floor [m, NED: down is positive]; landing aims at it."""


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One vehicle, its controller, its poses, its link, what it flies, and who may watch."""

    vehicle: Vehicle = Vehicle()
    controller: ControllerConfig = Gains()
    pose: PoseConfig = ViconConfig()
    gate: GateConfig = GateConfig()
    link: LinkConfig = MavlinkLinkConfig()
    trajectory: TrajectoryConfig = LemniscateConfig()
    limits: LimitsConfig = LimitsConfig()
    takeoff: TakeoffConfig = TakeoffConfig()
    flight: FlightConfig = FlightConfig()
    landing: LandingConfig = LandingConfig()
    guards: GuardsConfig = GuardsConfig()
    fence: FenceConfig | None = None
    """The room to stay in; a real flight needs one, and ``limits.max_speed_m_s``."""
    separation: SeparationConfig = SeparationConfig()
    operator: OperatorConfig = OperatorConfig()
    status: StatusConfig = StatusConfig()
    mqtt: MqttConfig = MqttConfig()
    recording: RecordingConfig = RecordingConfig()

    def __post_init__(self) -> None:
        """Check what the sections cannot.

        Raises:
            ValueError: the controller would count on more thrust than the full signal gives.
        """
        if self.flight.coast_s + self.guards.level_s > 1.0:
            raise ValueError("guards.level_s: with flight.coast_s at most 1 s: no pose vouches for more")
        if isinstance(self.pose, MavlinkPoseConfig) and self.forwards is not None:
            raise ValueError("link.forward.enabled: the poses are the autopilot's own, it must not be told them as new")
        others = self.separation.others
        if others and not isinstance(self.pose, ShowsOthers):
            kind = self.pose.__struct_config__.tag
            raise ValueError(f"separation.others: poses of kind {kind} show no other vehicle: leave it out")
        if self.body in others or len(set(others)) < len(others):
            raise ValueError("separation.others: expected each other vehicle once, and not this one's own object")
        self.operator.ensure_named()
        if self.operator.channel is not None and not isinstance(self.link, MavlinkLinkConfig):
            raise ValueError("operator.hold: a channel of the transmitter is told by link.kind mavlink alone")
        full, most = self.full_thrust_n, self.vehicle.thrust_max_n
        if full < (1.0 - HOVER_TOLERANCE) * most:
            raise ValueError(
                f"vehicle.thrust_max_n: {most:.4g} N is more than the full signal gives, {full:.4g} N by mass_kg, "
                f"hover_thrust and the thrust curve (f = {self.thrust_curve:g}): lower it, or correct one of these"
            )

    @property
    def body(self) -> str:
        """The vehicle's object in the capture system; empty where poses are of nothing else."""
        return str(getattr(self.pose, "object", "") or getattr(self.pose, "name", ""))

    @property
    def thrust_curve(self) -> float:
        """The curve in force, from signal to thrust (links/core/thrust_curve.py): the link's, or else the vehicle's."""
        return self.vehicle.thrust_curve if self.link.thrust_curve is None else self.link.thrust_curve

    @property
    def forwards(self) -> ForwardConfig | None:
        """How the autopilot gets our poses for its own estimator; None where it gets none."""
        if isinstance(self.link, MavlinkLinkConfig) and self.link.forward.enabled:
            return self.link.forward
        return None

    @property
    def shares_poses(self) -> bool:
        """Whether the poses are an autopilot's own, or such as bridges send to autopilots, too."""
        return isinstance(self.pose, MavlinkPoseConfig | VisionConfig)

    @property
    def full_thrust_n(self) -> float:
        """Thrust of the full signal [N]: by the hover thrust, where it is known."""
        vehicle = self.vehicle
        if vehicle.hover_thrust is None:
            return vehicle.thrust_max_n
        return full_thrust_n(vehicle.mass_kg * self.controller.gravity, vehicle.hover_thrust, self.thrust_curve)

    @property
    def weight_n(self) -> float:
        """The vehicle's weight as told [N]."""
        return self.vehicle.mass_kg * self.controller.gravity
