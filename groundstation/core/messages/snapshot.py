"""Snapshot and request: one frozen picture of a flight per command, which flows out, and the one way in. Sans-IO.

What goes between them: an estimator's estimate, a controller's decision, the controller's port. And flight events: what
happens in a flight, in order and typed; recorders, statistics and screens subscribe to them. Those with a tag are
records of a recording as they stand, too (groundstation/recording/records.py has the others).
"""

import math
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Annotated, Literal, NamedTuple, Protocol, TypeAlias

import msgspec

from groundstation.core.geometry import Quat, Real, Vec3
from groundstation.core.messages.pose import Pose, PoseStatus
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion
from links.core import Command, LinkStatus
from links.text import Numbers, Sentence, Severity

SETTLED_M = 0.10
"""A flight has settled once its error stays below this [m]."""
STEADY_S = 15.0
"""The steady part of a flight starts here on its trajectory [s], and ends where that is left."""
SATURATION_FROM_S = 5.0
"""Commands at a limit count from here on the trajectory [s]: the approach may use all there is."""
_ID = "Which sentence it is (docs/reference/messages.md); empty where it is none of that table."
_NUMBERS = "The numbers of that sentence, by their names."
ROUNDING_S = 1e-9
"""Tolerance for a sample's instant [s]: rounding of summed times must not decide whether it
counts."""


class SteadyError:
    """Root mean square and largest distance from the reference over the steady part: what every RMS here means.

    Against the estimate it has a sample a command; against the truth of a simulated flight, one a step of the plant.
    """

    def __init__(self) -> None:
        self._squares, self._count, self._max = 0.0, 0, 0.0

    def add(self, flight_time_s: float, error_m: float) -> None:
        """One sample on the trajectory; only those of the steady part count."""
        if flight_time_s >= STEADY_S - ROUNDING_S:
            self._squares += error_m * error_m
            self._count += 1
            self._max = max(self._max, error_m)

    @property
    def rms_m(self) -> float | None:
        """[m]; None before the steady part."""
        return math.sqrt(self._squares / self._count) if self._count else None

    @property
    def max_m(self) -> float | None:
        """[m]; None before the steady part."""
        return self._max if self._count else None


class Verdict(StrEnum):
    """Result of a check."""

    OFF = "OFF"
    PASS = "PASS"  # noqa: S105  # not a password
    WARN = "WARN"
    FAIL = "FAIL"


class Check(msgspec.Struct, frozen=True):
    """One check."""

    name: Annotated[str, msgspec.Meta(description="What was looked at.")]
    verdict: Annotated[Verdict, msgspec.Meta(description="How it is.")]
    says: Annotated[str, msgspec.Meta(description="A sentence: what was found, and what to do where it is not well.")]
    id: Annotated[str, msgspec.Meta(description=_ID)] = ""
    numbers: Annotated[Numbers, msgspec.Meta(description=_NUMBERS)] = {}

    @classmethod
    def of(cls, name: str, verdict: Verdict, sentence: Sentence) -> "Check":
        """Return the check ``name`` with what ``sentence`` says."""
        return cls(name, verdict, sentence.text, sentence.id, sentence.numbers)


NoticeKind: TypeAlias = Literal["state", "course", "certificate", "latency", "suspicion", "news"]


class Notice(msgspec.Struct, frozen=True):
    """Message to the operator about a flight, given once."""

    time_s: Annotated[float, msgspec.Meta(description="On the event loop's clock [s].")]
    state: Annotated[str, msgspec.Meta(description="Mission state (see mission.py).")]
    text: Annotated[str, msgspec.Meta(description="A sentence; of a `state` that begins, why.")]
    kind: Annotated[
        NoticeKind,
        msgspec.Meta(
            description="`state`: the mission is in another one; `course`: it flies elsewhere in "
            "the same; `certificate`: V or the disturbance estimate is beyond what the "
            "theory promises; `latency`: the vehicle is seen to move later or earlier "
            "than was told; `suspicion`: one of the poses begins; `news`: all else."
        ),
    ] = "news"
    severity: Annotated[Severity, msgspec.Meta(description="How grave it is.")] = Severity.INFO
    id: Annotated[str, msgspec.Meta(description=_ID)] = ""
    numbers: Annotated[Numbers, msgspec.Meta(description=_NUMBERS)] = {}

    @classmethod
    def of(cls, time_s: float, state: str, sentence: Sentence, kind: NoticeKind, severity: Severity) -> "Notice":
        """Return the notice of ``sentence``, given at ``time_s`` [s]."""
        return cls(time_s, state, sentence.text, kind, severity, sentence.id, sentence.numbers)

    @property
    def says(self) -> str:
        """The sentence as screens show it."""
        return f"{self.state}: {self.text}" if self.kind in ("state", "course") else self.text

    @property
    def line(self) -> str:
        """The message behind its time."""
        return f"{self.time_s:.3f} {self.says}"


class Say(Protocol):
    """Takes a sentence for the operator."""

    def __call__(self, sentence: Sentence, /) -> None:
        """Tell ``sentence``."""


class Diagnostics(msgspec.Struct, frozen=True, gc=False):
    """Internal values of the control law (symbols of the paper: control/backstepping.py)."""

    z1: Annotated[Vec3, msgspec.Meta(description="Position error p - pd [m], NED.")]
    z2: Annotated[Vec3, msgspec.Meta(description="Second backstepping error [m/s], NED.")]
    z3: Annotated[Vec3, msgspec.Meta(description="Third backstepping error [m/s²], NED.")]
    u_star: Annotated[Vec3, msgspec.Meta(description="Virtual control u* [m/s²], NED.")]
    b_hat: Annotated[Vec3, msgspec.Meta(description="Disturbance estimate [m/s²], NED.")]
    b_hat_dot: Annotated[Vec3, msgspec.Meta(description="Its rate as the law used it [m/s³], NED.")]
    disturbance: Annotated[
        Vec3,
        msgspec.Meta(
            description="The observer's own disturbance estimate d̂ [m/s²], NED; b̂ where composite adaptation is off."
        ),
    ]
    v_terms: Annotated[Vec3, msgspec.Meta(description="Σ φ(z1), ½|Ω(x2) + Ω(σ)|², ½|z3|²: all of V but its b̃ term.")]
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
            description="Which bound on V holds for the law that flies: `paper`, `composite` or `none`, and why not."
        ),
    ]
    thrust_rate: Annotated[float, msgspec.Meta(description="Ṫ as the law wants it [N/s].")] = 0.0
    rates_wanted: Annotated[
        Vec3, msgspec.Meta(description="Body rates as the law wants them [rad/s, FRD], before lags and limits.")
    ] = (0.0, 0.0, 0.0)


class Certificate(msgspec.Struct, frozen=True):
    """V against its bound since the first command (docs/explanation/law-proof.md, section 5.9)."""

    state: Annotated[
        str,
        msgspec.Meta(
            description="`holds`, `violated`, `suspended` (a command is at its limit, adaptation stops) or `none`."
        ),
    ]
    bound: Annotated[str, msgspec.Meta(description="Which bound it is, or why there is none.")]
    v: Annotated[
        float,
        msgspec.Meta(description="V_m: V with what the observer knows of the wind in the place of the truth [m²/s²]."),
    ]
    excess: Annotated[float, msgspec.Meta(description="How far it is above its bound [m²/s²].")]
    violated_fraction: Annotated[float, msgspec.Meta(description="Share of the time with a lasting violation [-].")]
    suspended_fraction: Annotated[float, msgspec.Meta(description="Share of the time with adaptation suspended [-].")]
    b_hat_fraction: Annotated[float | None, msgspec.Meta(description="|b̂|/(B + ε) [-]; None without adaptation.")]


class DisturbanceReading(msgspec.Struct, frozen=True, kw_only=True):
    """Disturbance of a flight, mean of the last second of commands away from the floor."""

    ned_m_s2: Annotated[
        Vec3,
        msgspec.Meta(
            description="Acceleration that thrust, drag and mass as configured do not explain [m/s², NED]: wind, and "
            "a thrust scale that is not 1. In steady flight only this sum is observable."
        ),
    ]
    wind_down_m_s2: Annotated[float, msgspec.Meta(description="The part of it that is wind, down [m/s²].")]
    wind_down_error_m_s2: Annotated[
        float | None, msgspec.Meta(description="Half of its 95 % interval [m/s²]; null where it is not known.")
    ]
    thrust_scale: Annotated[float, msgspec.Meta(description="True thrust over thrust as configured, λ̂ [-].")]
    thrust_scale_error: Annotated[
        float | None, msgspec.Meta(description="Half of its 95 % interval [-]; null where it is not known.")
    ]

    def describe_split(self) -> str:
        """Wind and thrust scale, each with its interval, in words."""
        wind, scale = f"wind down {self.wind_down_m_s2:+z.2f}", f"thrust {100.0 * self.thrust_scale:.1f}"
        if self.wind_down_error_m_s2 is None or self.thrust_scale_error is None:
            return f"{wind} m/s², {scale} %, intervals not known"
        return f"{wind} ± {self.wind_down_error_m_s2:.2f} m/s², {scale} ± {100.0 * self.thrust_scale_error:.1f} %"


class Snapshot(msgspec.Struct, frozen=True):
    """A flight as it was when one command was computed."""

    vehicle: Annotated[str, msgspec.Meta(description="Name of the vehicle, from the config.")]
    state: Annotated[str, msgspec.Meta(description="Mission state (see mission.py).")]
    reason: Annotated[
        str, msgspec.Meta(description="Why it is in that state, as a sentence for the operator; may be empty.")
    ]
    time_s: Annotated[float, msgspec.Meta(description="Event loop's clock when the command was computed [s].")]
    flight_time_s: Annotated[float, msgspec.Meta(description="Time since the reference started [s]; 0 before.")]
    pose_id: Annotated[int, msgspec.Meta(description="Newest pose used; -1 before the first.")]
    pose_age_s: Annotated[float, msgspec.Meta(description="Time since that pose was true [s].")]
    pose_rate_hz: Annotated[float, msgspec.Meta(description="Poses per second over the last second.")]
    poses_dropped: Annotated[dict[str, int], msgspec.Meta(description="Pose datagrams dropped, by reason.")]
    position_ned: Annotated[Vec3, msgspec.Meta(description="Estimate at the acting instant [m].")]
    velocity_ned: Annotated[Vec3, msgspec.Meta(description="[m/s]")]
    attitude: Annotated[Quat, msgspec.Meta(description="Body FRD to world NED, w first.")]
    reference_ned: Annotated[Vec3, msgspec.Meta(description="Where it should be [m].")]
    error_m: Annotated[float, msgspec.Meta(description="Distance between estimate and reference [m].")]
    rms_m: Annotated[
        float,
        msgspec.Meta(
            description="Root mean square of that distance over the steady part (`SteadyError`) [m]; 0 before it."
        ),
    ]
    thrust_n: Annotated[float, msgspec.Meta(description="Commanded thrust [N].")]
    thrust_max_n: Annotated[float, msgspec.Meta(description="Its upper limit [N].")]
    rates_rad_s: Annotated[Vec3, msgspec.Meta(description="Commanded body rates [rad/s].")]
    saturated: Annotated[bool, msgspec.Meta(description="True where any of the four was clamped.")]
    diagnostics: Annotated[
        Diagnostics | None, msgspec.Meta(description="The control law's own view; None while no law runs.")
    ]
    link: Annotated[LinkStatus, msgspec.Meta(description="The command link.")]
    floor_z_m: Annotated[
        float,
        msgspec.Meta(description="Down coordinate of the floor [m, NED]; heights count from it."),
    ] = 0.0
    events: Annotated[
        tuple[Notice, ...], msgspec.Meta(description="What the operator was told last (at most 20), oldest first.")
    ] = ()
    rate_limits_rad_s: Annotated[
        Vec3 | None, msgspec.Meta(description="Largest body rates that are commanded [rad/s], where known.")
    ] = None
    thrust_effectiveness: Annotated[
        float, msgspec.Meta(description="λ̂: true thrust over told thrust, as the estimator finds it [-].")
    ] = 1.0
    disturbance: Annotated[
        DisturbanceReading | None,
        msgspec.Meta(description="What disturbs the vehicle, and its split; null before the first hold or trajectory."),
    ] = None
    certificate: Annotated[
        Certificate | None, msgspec.Meta(description="V against its bound; None before the second command.")
    ] = None
    pose_latency_s: Annotated[
        float,
        msgspec.Meta(description="From the instant of a pose to its arrival here, averaged over some fifty poses [s]."),
    ] = 0.0
    pose_latency_max_s: Annotated[float, msgspec.Meta(description="The longest of the flight [s].")] = 0.0
    pose_gaps: Annotated[int, msgspec.Meta(description="How often poses were missing.")] = 0
    pose_clock_steps: Annotated[
        int, msgspec.Meta(description="How often the source's clock leapt ahead or began anew.")
    ] = 0
    checks: Annotated[
        tuple[Check, ...],
        msgspec.Meta(
            description="The pre-flight checks as they were made last; empty before the first, and "
            "once the vehicle flies."
        ),
    ] = ()
    late_us: Annotated[
        tuple[int, int, int] | None,
        msgspec.Meta(
            description="How late commands left after their frame, or where they follow poses, "
            "after their pose came: not later than this were 50 %, 99 % and 99.9 % of "
            "them [µs]; None before the first."
        ),
    ] = None
    late_octaves: Annotated[
        tuple[int, ...],
        msgspec.Meta(description="Entry k: how many left later by less than 2**k µs, and not by less than 2**(k-1)."),
    ] = ()
    gains: Annotated[
        dict[str, float],
        msgspec.Meta(
            description="The gains that may be changed in flight, by their keys in the configuration, as they are now."
        ),
    ] = {}


class Ask(StrEnum):
    """Requests. The mission's table says whether one is possible now."""

    ARM = "arm"
    """Start the motors and take off."""
    TRACK = "track"
    """Leave the hold for the trajectory."""
    GOTO = "goto"
    """In hold: fly to one point after the other, and hold at the last."""
    HOLD = "hold"
    """Stop and stay there."""
    RETURN = "return"
    """Fly back over the place of take-off and land there."""
    LAND = "land"
    """Land here; before take-off, end the flight."""
    DESCEND = "descend"
    """Failsafe descent: level and down at once, by attitude and speed alone."""
    ABORT = "abort"
    """Commands stop; the link brings the vehicle down by itself."""
    KILL = "kill"
    """Motors off at once, also in the air."""


RemoteAsk = Literal["hold", "return", "track", "goto", "land", "descend", "abort", "kill"]
"""Requests that may come from afar: all but to arm."""

FARTHEST_M = 1000.0
"""Largest coordinate of a requested point along each axis [m]."""
TURN_DEG = 360.0
"""Largest heading of a request, either way [deg]."""
_Metres = Annotated[float, msgspec.Meta(ge=-FARTHEST_M, le=FARTHEST_M)]


class Waypoint(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A point to fly to. On the wire ``[north, east, down]`` or ``[north, east, down, yaw]``."""

    north_m: Annotated[_Metres, msgspec.Meta(description="World NED [m], as the next two.")]
    east_m: Annotated[_Metres, msgspec.Meta(description="Eastwards.")]
    down_m: Annotated[_Metres, msgspec.Meta(description="1 m up is -1.")]
    yaw_deg: Annotated[
        Annotated[float, msgspec.Meta(ge=-TURN_DEG, le=TURN_DEG)] | None,
        msgspec.Meta(description="Heading there, from north towards east; None: as it was."),
    ] = None

    def __post_init__(self) -> None:
        most = dict.fromkeys(("north_m", "east_m", "down_m"), FARTHEST_M)
        for name, far in most.items() if self.yaw_deg is None else (most | {"yaw_deg": TURN_DEG}).items():
            value = getattr(self, name)
            if not (isinstance(value, int | float) and abs(value) <= far):  # also NaN
                raise ValueError(f"{name}: expected a number from {-far:g} to {far:g}, got {value!r}")

    @property
    def place_ned(self) -> Vec3:
        """The point [m, NED]."""
        return (self.north_m, self.east_m, self.down_m)


MOST_POINTS = 64
"""One request leads to no more."""
Waypoints = Annotated[tuple[Waypoint, ...], msgspec.Meta(max_length=MOST_POINTS)]


def ensure_points(ask: str | None, points: Sequence[Waypoint]) -> None:
    """Points travel with ``goto``, and with nothing else.

    Raises:
        ValueError: there are none, or they belong to nothing.
    """
    if (ask == Ask.GOTO) != bool(points):
        raise ValueError("points: expected 1 to 64 with goto, and none with anything else")


class Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One request, and why."""

    ask: Ask
    """The requested action."""
    why: str = ""
    """Requester and reason, for the operator to read."""
    points: Waypoints = ()
    """Where to, for ``goto``."""

    def __post_init__(self) -> None:
        ensure_points(self.ask, self.points)


class Reply(msgspec.Struct, frozen=True):
    """Answer to a request."""

    done: bool
    says: str
    """The action taken, or the reason against it, for the operator."""
    id: str = ""
    """Which sentence it is (docs/reference/messages.md)."""
    numbers: Numbers = {}
    """Its numbers, by their names."""

    @classmethod
    def of(cls, done: bool, sentence: Sentence) -> "Reply":
        """Return the answer with what ``sentence`` says."""
        return cls(done, sentence.text, sentence.id, sentence.numbers)


def decode(text: bytes) -> Request | None:
    """The request in a JSON object such as ``{"ask": "land", "why": "MQTT"}``; None where it is none."""
    try:
        return msgspec.json.decode(text, type=Request)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


class Estimate(NamedTuple):
    """The vehicle at the instant a command will act."""

    time_s: float
    """That instant, on the event loop's clock [s]."""
    motion: Motion
    """Position, velocity, attitude, thrust and body rates there."""
    disturbance: Vec3
    """The observer's disturbance d̂ [m/s², NED]."""
    disturbance_step: Vec3
    """Change of b̂ by the innovations since the last estimate [m/s²] (raw composite form; else
    zero)."""
    effectiveness: Real = 1.0
    """λ̂: true thrust over told thrust [-]; the vehicle's told mass over it is what thrust seems to lift."""
    effectiveness_deviation: Real = 0.0
    """Standard deviation of λ̂ [-]: only the sum of wind and thrust scale shows while thrust stays as it is."""


class Decision(NamedTuple):
    """Command of a controller, and its derivation."""

    drive: ActuatorCommand
    """Thrust [N] and body rates [rad/s, FRD], within the vehicle's limits."""
    saturated: bool
    """True where any of the four was clamped."""
    diagnostics: Diagnostics


class Controller(Protocol):
    """An estimate and a reference in, a command out. Sans-IO; state inside."""

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; ``interval_s`` [s] has passed since the last one (0 at the first)."""


class CertificateReading(NamedTuple):
    """State of the certificate's watch at one command."""

    state: str
    """``holds``, ``violated``, ``suspended`` (a command was clamped: adaptation stops) or ``none`` (no promise)."""
    excess: float
    """V_m above its bound [m²/s²]."""
    warnings: tuple[Sentence, ...]
    """Sentences for the operator, one for each lasting violation as it begins to last; mostly none."""


class Tick(NamedTuple):
    """Everything about one command, for records and screens."""

    time_s: float
    """When it was computed, on the event loop's clock [s]."""
    flight_time_s: float
    """Time on the trajectory at the instant it acts [s]."""
    pose: Pose
    """The newest pose it rests on."""
    estimate: Estimate
    reference: Reference
    decision: Decision
    command: Command
    seen: CertificateReading
    """V against its bound."""


class PoseRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=4):
    """The pilot was given a pose."""

    pose: Pose


class TrajectoryRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=5):
    """The pilot was given a trajectory, begun at ``time_s``."""

    time_s: float


class IdleRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=6):
    """The pilot made an idle command."""

    time_s: float
    thrust_n: float
    command: Command


class TickRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=7):
    """The pilot made a command."""

    tick: Tick
    late_s: float | None = None
    """Delay for its frame or after its pose came [s]; None for one in between."""


class RequestRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=9):
    """Somebody asked for something: the flight's method ``what``, and why."""

    time_s: float
    what: str
    reason: str


class StatusRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=10):
    """State of link and pose source, at intervals."""

    time_s: float
    link: LinkStatus
    source: PoseStatus


class EndRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=12):
    """The flight is over."""

    time_s: float
    state: str
    reason: str
    id: str = ""
    """Which sentence the reason is (docs/reference/messages.md)."""
    numbers: Numbers = {}


GAIN = "gain "
"""Prefix of the event of a gain changed in flight, followed by the gain's name."""


class SwitchRecord(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=13):
    """The pilot was told to fly otherwise: its method ``what``, with these numbers."""

    time_s: float
    what: str
    values: tuple[float, ...]


class CommandSent(NamedTuple):
    """A command of the controller has left."""

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
Subscriber: TypeAlias = Callable[[FlightEvent], None]
"""Hears each event as it happens; never waits, never raises."""


def ignore(_: FlightEvent | Tick) -> None:
    """The subscriber of a flight that nobody looks at."""


def tell_lines(say: Callable[[str], None]) -> Subscriber:
    """A subscriber that has ``say`` told each notice as a line."""

    def hear(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            say(event.line)

    return hear
