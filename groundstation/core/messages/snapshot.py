"""Messages of a flight. Sans-IO.

- :class:`Snapshot`: the state of a flight at each command, for screens, sockets and MQTT.
- :class:`Request` and :class:`Reply`: an operator's request to a flight, and the reply.
- :class:`Estimate`, :class:`Decision`, :class:`Controller`: input, output and port of a controller.
- Flight events, from :class:`Notice` to :class:`CommandSent`: recorders, statistics and screens
  subscribe to them. Events with a tag are also written to recordings as they are
  (groundstation/recording/records.py has the others).
"""

import math
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Annotated, Literal, NamedTuple, Protocol, TypeAlias

import msgspec

from groundstation.core.geometry import FARTHEST_M, Coordinate, Quat, Real, Vec3
from groundstation.core.messages.notices import notice
from groundstation.core.messages.pose import Pose, PoseStatus
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion
from links.core import Command, LinkStatus
from links.text import Numbers, Sentence, Severity, to_percent

PAPER = {"rms_cm": 4.61, "max_cm": 7.6, "settle_s": 5.0}
"""Figures of the paper's own flight: Cabecinhas, Cunha, Silvestre, ACC 2013, section VI."""
SETTLED_M = 0.10
"""Error below which a flight has settled, if it stays there [m]. Chosen."""
STEADY_S = 15.0
"""Time on the trajectory at which the steady part of a flight begins [s]; it ends with the
trajectory. Chosen: beyond the transient at its beginning."""
LEAST_JUDGED_S = STEADY_S + 1.0
"""Time on the trajectory that a flight must last for its errors to be judged [s]: of less than a
second, an RMS is that of a few instants. Chosen."""
SATURATION_FROM_S = 5.0
"""Time on the trajectory from which commands at a limit are counted [s]. Chosen: the approach may
use full thrust."""
_ID = "Id of the sentence (docs/reference/messages.md); empty if it is not in that table."
_NUMBERS = "The numbers in the sentence, by their names."
ROUNDING_S = 1e-9
"""Tolerance for a sample's instant [s]: rounding of summed times must not decide whether it
counts."""


def begin_of_steady_part(flown_s: float) -> float:
    """Return the time on the trajectory at which the steady part begins [s].

    Infinite where ``flown_s``, all that is flown of the trajectory [s], is too short to be judged.
    """
    return STEADY_S - ROUNDING_S if flown_s >= LEAST_JUDGED_S - ROUNDING_S else math.inf


class SteadyError:
    """Root mean square and largest distance from the reference over the steady part.

    Every RMS of this project is it.

    Against the estimate it has one sample per command; against the truth of a simulated flight, one
    per plant step.
    """

    def __init__(self) -> None:
        self._squares, self._count, self._max = 0.0, 0, 0.0
        self._flown_s = 0.0

    def add(self, flight_time_s: float, error_m: float) -> None:
        """Take one sample on the trajectory; samples before the steady part are ignored."""
        self._flown_s = flight_time_s
        if flight_time_s >= STEADY_S - ROUNDING_S:
            self._squares += error_m * error_m
            self._count += 1
            self._max = max(self._max, error_m)

    @property
    def rms_m(self) -> float | None:
        """Root mean square [m]; None where too little is flown to be judged."""
        return math.sqrt(self._squares / self._count) if self._is_judged else None

    @property
    def max_m(self) -> float | None:
        """Largest distance [m]; None where too little is flown to be judged."""
        return self._max if self._is_judged else None

    @property
    def _is_judged(self) -> bool:
        return self._count > 0 and math.isfinite(begin_of_steady_part(self._flown_s))


class Verdict(StrEnum):
    """Verdict of a check: does not apply, good, may fly with a warning, must not fly."""

    OFF = "OFF"
    PASS = "PASS"  # noqa: S105  # not a password
    WARN = "WARN"
    FAIL = "FAIL"


class Check(msgspec.Struct, frozen=True):
    """Result of one check before take-off."""

    name: Annotated[str, msgspec.Meta(description="Subject of the check.")]
    verdict: Annotated[
        Verdict, msgspec.Meta(description="OFF (does not apply), PASS, WARN or FAIL.")
    ]
    says: Annotated[
        str, msgspec.Meta(description="Finding, and remedy unless it passes, as a sentence.")
    ]
    id: Annotated[str, msgspec.Meta(description=_ID)] = ""
    numbers: Annotated[Numbers, msgspec.Meta(description=_NUMBERS)] = {}

    @classmethod
    def of(cls, name: str, verdict: Verdict, sentence: Sentence) -> "Check":
        """Make the result of the check ``name`` with ``sentence``."""
        return cls(name, verdict, sentence.text, sentence.id, sentence.numbers)


NoticeKind: TypeAlias = Literal["state", "course", "certificate", "latency", "suspicion", "news"]
"""Kinds of notices; ``Notice.kind`` explains them."""


class Notice(msgspec.Struct, frozen=True):
    """Message to the operator about a flight, given once."""

    time_s: Annotated[
        float, msgspec.Meta(description="Time of the notice, on the event loop's clock [s].")
    ]
    state: Annotated[str, msgspec.Meta(description="Mission state (see mission.py).")]
    text: Annotated[
        str,
        msgspec.Meta(description="The sentence; for kind `state`, the reason of the new state."),
    ]
    kind: Annotated[
        NoticeKind,
        msgspec.Meta(
            description="`state`: the mission has changed its state; `course`: it has a new course "
            "within its state; `certificate`: V or the disturbance estimate exceeds the bound of "
            "the theory; `latency`: the measured latency of poses or vehicle differs from the "
            "configured one; `suspicion`: the poses begin to be suspected; `news`: anything else."
        ),
    ] = "news"
    severity: Annotated[Severity, msgspec.Meta(description="Severity.")] = Severity.INFO
    id: Annotated[str, msgspec.Meta(description=_ID)] = ""
    numbers: Annotated[Numbers, msgspec.Meta(description=_NUMBERS)] = {}

    @classmethod
    def of(
        cls, time_s: float, state: str, sentence: Sentence, kind: NoticeKind, severity: Severity
    ) -> "Notice":
        """Make the notice of ``sentence`` at ``time_s`` [s]."""
        return cls(time_s, state, sentence.text, kind, severity, sentence.id, sentence.numbers)

    @property
    def says(self) -> str:
        """The sentence as screens show it."""
        return f"{self.state}: {self.text}" if self.kind in ("state", "course") else self.text

    @property
    def line(self) -> str:
        """Time and sentence as a line of a log."""
        return f"{self.time_s:.3f} {self.says}"


class Say(Protocol):
    """Port that takes sentences for the operator."""

    def __call__(self, sentence: Sentence, /) -> None:
        """Show ``sentence``."""


class Diagnostics(msgspec.Struct, frozen=True, gc=False):
    """Internal values of the control law (symbols of the paper: control/backstepping.py)."""

    z1: Annotated[Vec3, msgspec.Meta(description="Position error p - pd [m], NED.")]
    z2: Annotated[Vec3, msgspec.Meta(description="Second backstepping error [m/s], NED.")]
    z3: Annotated[Vec3, msgspec.Meta(description="Third backstepping error [m/s²], NED.")]
    u_star: Annotated[Vec3, msgspec.Meta(description="Virtual control u* [m/s²], NED.")]
    b_hat: Annotated[Vec3, msgspec.Meta(description="Disturbance estimate [m/s²], NED.")]
    b_hat_dot: Annotated[
        Vec3, msgspec.Meta(description="Rate at which the law changes it [m/s³], NED.")
    ]
    disturbance: Annotated[
        Vec3,
        msgspec.Meta(
            description="The observer's own disturbance estimate d̂ [m/s²], NED; b̂ where "
            "composite adaptation is off."
        ),
    ]
    v_terms: Annotated[
        Vec3,
        msgspec.Meta(description="Σ φ(z1), ½|Ω(x2) + Ω(σ)|², ½|z3|²: all of V but its b̃ term."),
    ]
    w_terms: Annotated[Vec3, msgspec.Meta(description="σᵀσ, k2 z2ᵀρ(z2), k3|z3|²: all of W.")]
    v_known: Annotated[float, msgspec.Meta(description="The sum of `v_terms`.")]
    w: Annotated[
        float,
        msgspec.Meta(
            description="The sum of `w_terms`: V falls at least this fast on the ideal plant, with "
            "the paper's adaptation."
        ),
    ]
    certificate: Annotated[
        str,
        msgspec.Meta(
            description="Which bound on V holds for the law that flies: `paper`, `composite` or "
            "`none`, and why not."
        ),
    ]
    thrust_rate: Annotated[
        float, msgspec.Meta(description="Ṫ of the law, before lags and limits [N/s].")
    ] = 0.0
    rates_wanted: Annotated[
        Vec3,
        msgspec.Meta(description="Body rates of the law, before lags and limits [rad/s, FRD]."),
    ] = (0.0, 0.0, 0.0)


class Certificate(msgspec.Struct, frozen=True):
    """V and its bound since the first command (docs/explanation/law-proof.md, section 5.9)."""

    state: Annotated[
        str,
        msgspec.Meta(
            description="`holds`, `violated`, `suspended` (a command is at its limit, adaptation "
            "stops) or `none`."
        ),
    ]
    bound: Annotated[
        str, msgspec.Meta(description="Name of the bound, or the reason why there is none.")
    ]
    v: Annotated[
        float,
        msgspec.Meta(
            description="V_m: V with the observer's disturbance in the place of the true one "
            "[m²/s²]."
        ),
    ]
    excess: Annotated[float, msgspec.Meta(description="V_m above its bound [m²/s²].")]
    violated_fraction: Annotated[
        float, msgspec.Meta(description="Share of the time with a lasting violation [-].")
    ]
    suspended_fraction: Annotated[
        float, msgspec.Meta(description="Share of the time with adaptation suspended [-].")
    ]
    b_hat_fraction: Annotated[
        float | None, msgspec.Meta(description="|b̂|/(B + ε) [-]; None without adaptation.")
    ]


class DisturbanceReading(msgspec.Struct, frozen=True, kw_only=True):
    """Disturbance of a flight, averaged over the last second of commands away from the floor."""

    ned_m_s2: Annotated[
        Vec3,
        msgspec.Meta(
            description="Acceleration that thrust, drag and mass as configured do not explain "
            "[m/s², NED]: wind, and a thrust scale that is not 1. In steady flight only this sum "
            "is observable."
        ),
    ]
    wind_down_m_s2: Annotated[
        float, msgspec.Meta(description="Estimated wind in its down component [m/s²].")
    ]
    wind_down_error_m_s2: Annotated[
        float | None,
        msgspec.Meta(
            description="Half width of the wind's 95 % interval [m/s²]; null if it is not known."
        ),
    ]
    thrust_scale: Annotated[
        float, msgspec.Meta(description="Estimated true over configured thrust, λ̂ [-].")
    ]
    thrust_scale_error: Annotated[
        float | None,
        msgspec.Meta(description="Half width of its 95 % interval [-]; null if it is not known."),
    ]

    def describe_split(self) -> str:
        """Describe wind and thrust scale, each with its interval."""
        wind = f"wind down {self.wind_down_m_s2:+z.2f}"
        scale = f"thrust {to_percent(self.thrust_scale):.1f}"
        if self.wind_down_error_m_s2 is None or self.thrust_scale_error is None:
            return f"{wind} m/s², {scale} %, intervals not known"
        return (
            f"{wind} ± {self.wind_down_error_m_s2:.2f} m/s², {scale} ± "
            f"{to_percent(self.thrust_scale_error):.1f} %"
        )


class Snapshot(msgspec.Struct, frozen=True):
    """State of a flight at one command."""

    vehicle: Annotated[str, msgspec.Meta(description="Name of the vehicle, from the config.")]
    state: Annotated[str, msgspec.Meta(description="Mission state (see mission.py).")]
    reason: Annotated[
        str,
        msgspec.Meta(
            description="Reason of that state, as a sentence for the operator; may be empty."
        ),
    ]
    time_s: Annotated[
        float, msgspec.Meta(description="Event loop's clock when the command was computed [s].")
    ]
    flight_time_s: Annotated[
        float, msgspec.Meta(description="Time since the reference started [s]; 0 before.")
    ]
    pose_id: Annotated[int, msgspec.Meta(description="Newest pose used; -1 before the first.")]
    pose_age_s: Annotated[float, msgspec.Meta(description="Time since that pose was true [s].")]
    pose_rate_hz: Annotated[
        float, msgspec.Meta(description="Poses per second over the last second.")
    ]
    poses_dropped: Annotated[
        dict[str, int], msgspec.Meta(description="Pose datagrams dropped, by reason.")
    ]
    position_ned: Annotated[
        Vec3,
        msgspec.Meta(
            description="Estimated position at the instant at which the command acts [m]."
        ),
    ]
    velocity_ned: Annotated[
        Vec3, msgspec.Meta(description="Estimated velocity at that instant [m/s].")
    ]
    attitude: Annotated[
        Quat,
        msgspec.Meta(
            description="Estimated attitude at that instant: body FRD to world NED, w first."
        ),
    ]
    reference_ned: Annotated[
        Vec3, msgspec.Meta(description="Position of the reference at that instant [m].")
    ]
    error_m: Annotated[
        float, msgspec.Meta(description="Distance between estimate and reference [m].")
    ]
    rms_m: Annotated[
        float,
        msgspec.Meta(
            description="Root mean square of that distance over the steady part (`SteadyError`) "
            "[m]; 0 before it."
        ),
    ]
    thrust_n: Annotated[float, msgspec.Meta(description="Commanded thrust [N].")]
    thrust_max_n: Annotated[float, msgspec.Meta(description="Upper limit of the thrust [N].")]
    rates_rad_s: Annotated[Vec3, msgspec.Meta(description="Commanded body rates [rad/s].")]
    saturated: Annotated[
        bool, msgspec.Meta(description="Whether thrust or a body rate was clamped.")
    ]
    diagnostics: Annotated[
        Diagnostics | None,
        msgspec.Meta(description="Internal values of the control law; None while it does not run."),
    ]
    link: Annotated[LinkStatus, msgspec.Meta(description="State of the command link.")]
    floor_z_m: Annotated[
        float,
        msgspec.Meta(description="Down coordinate of the floor [m, NED]; heights count from it."),
    ] = 0.0
    events: Annotated[
        tuple[Notice, ...],
        msgspec.Meta(description="Newest notices to the operator (at most 20), oldest first."),
    ] = ()
    rate_limits_rad_s: Annotated[
        Vec3 | None,
        msgspec.Meta(
            description="Largest body rates that are commanded [rad/s]; None if not known."
        ),
    ] = None
    disturbance: Annotated[
        DisturbanceReading | None,
        msgspec.Meta(
            description="Disturbance, split into wind and thrust scale; null before the first hold "
            "or trajectory."
        ),
    ] = None
    certificate: Annotated[
        Certificate | None,
        msgspec.Meta(description="V against its bound; None before the second command."),
    ] = None
    pose_latency_s: Annotated[
        float,
        msgspec.Meta(
            description="Mean time from the instant of a pose to its arrival here, over about "
            "fifty poses [s]."
        ),
    ] = 0.0
    pose_latency_max_s: Annotated[
        float, msgspec.Meta(description="Longest such time of the flight [s].")
    ] = 0.0
    pose_gaps: Annotated[int, msgspec.Meta(description="Number of gaps in the poses.")] = 0
    pose_clock_steps: Annotated[
        int, msgspec.Meta(description="Number of forward steps and restarts of the source's clock.")
    ] = 0
    checks: Annotated[
        tuple[Check, ...],
        msgspec.Meta(
            description="Newest pre-flight checks; empty before the first, and once the vehicle "
            "flies."
        ),
    ] = ()
    late_us: Annotated[
        tuple[int, int, int] | None,
        msgspec.Meta(
            description="Lateness of the commands, 50, 99 and 99.9 % [µs]: after the instant of "
            "the frame, or after the arrival of the pose for a link paced by poses; None before "
            "the first."
        ),
    ] = None
    gains: Annotated[
        dict[str, float],
        msgspec.Meta(
            description="Present values of the gains that may be changed in flight, by "
            "configuration key."
        ),
    ] = {}


class Ask(StrEnum):
    """Requests to a flight. The mission's table decides which are possible in which state."""

    ARM = "arm"
    """Start the motors and take off."""
    TRACK = "track"
    """Leave the hold for the trajectory."""
    GOTO = "goto"
    """In hold: fly to one point after the other, and hold at the last."""
    HOLD = "hold"
    """Stop and hold the position."""
    RETURN = "return"
    """Fly back over the place of take-off and land there."""
    LAND = "land"
    """Land here; before take-off, end the flight."""
    DESCEND = "descend"
    """Failsafe descent: level and down at once, by attitude and speed alone."""
    ABORT = "abort"
    """Stop the commands; the link brings the vehicle down by itself."""
    KILL = "kill"
    """Motors off at once, also in the air."""


RemoteAsk = Literal["hold", "return", "track", "goto", "land", "descend", "abort", "kill"]
"""Requests that remote clients may send: all but to arm."""

TURN_DEG = 360.0
"""Largest heading of a request, either way [deg]: a full turn."""


class Waypoint(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A point to fly to. On the wire ``[north, east, down]`` or ``[north, east, down, yaw]``."""

    north_m: Annotated[Coordinate, msgspec.Meta(description="North [m, world NED].")]
    east_m: Annotated[Coordinate, msgspec.Meta(description="East [m, world NED].")]
    down_m: Annotated[Coordinate, msgspec.Meta(description="Down [m, world NED]: 1 m up is -1.")]
    yaw_deg: Annotated[
        Annotated[float, msgspec.Meta(ge=-TURN_DEG, le=TURN_DEG)] | None,
        msgspec.Meta(
            description="Heading there [deg], from north towards east; None keeps the present one."
        ),
    ] = None

    def __post_init__(self) -> None:
        limits = {
            "north_m": FARTHEST_M,
            "east_m": FARTHEST_M,
            "down_m": FARTHEST_M,
            "yaw_deg": TURN_DEG,
        }
        for name, limit in limits.items():
            value = getattr(self, name)
            if name == "yaw_deg" and value is None:
                continue
            if not (isinstance(value, int | float) and abs(value) <= limit):  # NaN is refused, too
                raise ValueError(
                    notice("request.waypoint", name=name, least=-limit, most=limit, found=value)
                )

    @property
    def place_ned(self) -> Vec3:
        """The point [m, NED]."""
        return (self.north_m, self.east_m, self.down_m)


MOST_POINTS = 64
"""Limit of the points of one request [-]. Chosen: bounds its size."""
Waypoints = Annotated[tuple[Waypoint, ...], msgspec.Meta(max_length=MOST_POINTS)]


def ensure_points(ask: str | None, points: Sequence[Waypoint]) -> None:
    """Require points with ``goto``, and none with any other request.

    Raises:
        ValueError: there are none with ``goto``, or some with another request.
    """
    if (ask == Ask.GOTO) != bool(points):
        raise ValueError(notice("request.only_goto", most=MOST_POINTS))


class Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One request to a flight, with its reason."""

    ask: Ask
    """The requested action."""
    why: str = ""
    """Requester and reason, for the operator to read."""
    points: Waypoints = ()
    """Points to fly to, for ``goto``."""

    def __post_init__(self) -> None:
        ensure_points(self.ask, self.points)


class Reply(msgspec.Struct, frozen=True):
    """Reply to a request."""

    done: bool
    says: str
    """The action taken, or the reason against it, for the operator."""
    id: str = ""
    """Id of that sentence (docs/reference/messages.md)."""
    numbers: Numbers = {}
    """The numbers in that sentence, by their names."""

    @classmethod
    def of(cls, done: bool, sentence: Sentence) -> "Reply":
        """Make the reply with ``sentence``."""
        return cls(done, sentence.text, sentence.id, sentence.numbers)


def decode(text: bytes) -> Request | None:
    """Decode a request from a JSON object such as ``{"ask": "land", "why": "MQTT"}``.

    None if it is not one.
    """
    try:
        return msgspec.json.decode(text, type=Request)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


class Estimate(NamedTuple):
    """Estimated state of the vehicle at the instant at which a command will act."""

    time_s: float
    """That instant, on the event loop's clock [s]."""
    motion: Motion
    """Position, velocity, attitude, thrust and body rates at that instant."""
    disturbance: Vec3
    """The observer's disturbance d̂ [m/s², NED]."""
    disturbance_step: Vec3
    """Change of b̂ by the innovations since the last estimate [m/s²] (raw composite form; else
    zero)."""
    effectiveness: Real = 1.0
    """λ̂: true thrust over commanded thrust [-]. Models use the configured mass divided by it."""
    effectiveness_deviation: Real = 0.0
    """Standard deviation of λ̂ [-]. It falls only while thrust changes: else only wind plus scale
    is observable."""


class Decision(NamedTuple):
    """Command of a controller, with the values that led to it."""

    drive: ActuatorCommand
    """Thrust [N] and body rates [rad/s, FRD], within the vehicle's limits."""
    saturated: bool
    """Whether thrust or a body rate was clamped."""
    diagnostics: Diagnostics


class Controller(Protocol):
    """Port of a controller, which computes a command from an estimate and a reference.

    It does no I/O.
    """

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Compute one command.

        ``interval_s`` is the time since the last one [s], 0 at the first.
        """


class CertificateReading(NamedTuple):
    """State of the certificate's monitor at one command."""

    state: str
    """``holds``, ``violated``, ``suspended`` (a command was clamped: adaptation stops) or ``none``
    (no bound)."""
    excess: float
    """V_m above its bound [m²/s²]."""
    warnings: tuple[Sentence, ...]
    """Sentences for the operator: one for each violation, once it has lasted 0.5 s."""


class Tick(NamedTuple):
    """All values of one command, for records and screens."""

    time_s: float
    """Time of its computation, on the event loop's clock [s]."""
    flight_time_s: float
    """Time on the trajectory at the instant at which it acts [s]."""
    pose: Pose
    """Newest pose that was used."""
    estimate: Estimate
    reference: Reference
    decision: Decision
    command: Command
    certificate: CertificateReading
    """V and its bound."""


class PoseRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """The pilot was given a pose."""

    pose: Pose


class TrajectoryRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """The pilot was given a trajectory that begins at ``time_s`` [s]."""

    time_s: float


class IdleRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """The pilot made an idle command."""

    time_s: float
    thrust_n: float
    command: Command


class TickRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """The pilot made a command."""

    tick: Tick
    late_s: float | None = None
    """Delay after the instant of its frame, or after the arrival of its pose [s]; None for one
    between two poses."""


class RequestRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """A request was made: ``what`` is the flight's method that was called."""

    time_s: float
    what: str
    reason: str


class StatusRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """State of link and pose source, at intervals."""

    time_s: float
    link: LinkStatus
    source: PoseStatus


class EndRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """The flight is over."""

    time_s: float
    state: str
    reason: str
    id: str = ""
    """Id of the reason's sentence (docs/reference/messages.md)."""
    numbers: Numbers = {}


GAIN = "gain "
"""Prefix of ``SwitchRecord.what`` for a gain changed in flight, before the gain's name."""


class SwitchRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=True):
    """The pilot was switched to another mode of flight: its method ``what`` was called with
    ``values``.
    """

    time_s: float
    what: str
    values: tuple[float, ...]


class CommandSent(NamedTuple):
    """A command of the controller was sent."""

    tick: Tick


FlightEvent: TypeAlias = (
    Notice
    | PoseRecord
    | TrajectoryRecord
    | IdleRecord
    | TickRecord
    | RequestRecord
    | StatusRecord
    | EndRecord
    | SwitchRecord
    | CommandSent
)
"""Every event of a flight."""
Subscriber: TypeAlias = Callable[[FlightEvent], None]
"""Called with each event as it happens. It must not wait and must not raise."""


def ignore(_: FlightEvent | Tick) -> None:
    """A subscriber that does nothing."""


def tell_lines(say: Callable[[str], None]) -> Subscriber:
    """Make a subscriber that calls ``say`` with each notice as a line."""

    def call(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            say(event.line)

    return call
