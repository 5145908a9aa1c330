"""Feeds of a dashboard: a running ground station, attached to again when it was lost, or a recording, played back."""

import asyncio
import math
from bisect import bisect_right
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from groundstation.config import parse_toml
from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Ask, Certificate, Diagnostics, PoseStatus, Reply, Request, Snapshot, SteadyError
from groundstation.core.mission import State
from groundstation.core.safety import LIVE, PREFIX
from groundstation.interfaces.api import Control, OrderAnswer, StationClient, attach
from groundstation.interfaces.tui.model import KEPT, FeedTrouble, FlightIdentity, Holder, Jump, News, PlayedSnapshot
from groundstation.recording import GAIN, Entry, Recording
from groundstation.runtime import ApiError
from links.core import Lateness, LinkStatus

RETRY_S = 0.5
"""Time between two tries to attach [s]."""
NAME = "tui"


class Attached:
    """Implements :class:`groundstation.interfaces.tui.model.Feed`.

    What is asked while nobody is there is not asked later.
    """

    live = True

    def __init__(self, path: Path, pid: int | None = None, gone: Callable[[], str] = str) -> None:
        """For the socket at ``path``; it may come and go.

        ``pid``: only this process is meant; ``gone`` says more about it where it does not serve, or nothing.
        """
        self._path = path
        self._pid, self._gone = pid, gone
        self._client: StationClient | None = None

    async def news(self) -> AsyncIterator[News]:
        """For ever, what is served, and why nothing is."""
        while True:
            trouble = "The ground station closed its status socket."
            try:
                self._client = await attach(self._path, NAME)
                hello = self._client.hello
                if self._pid not in (None, hello.pid):
                    raise ApiError(f"{self._path}: another ground station (process {hello.pid}) serves there")
                origin = f"process {hello.pid}, groundstation {hello.groundstation}"
                yield FlightIdentity(hello.vehicle, origin, hello.config)
                async for message in self._client:
                    yield _holder(message) if isinstance(message, Control) else message
            except FileNotFoundError:
                trouble = f"No ground station serves {self._path}."
            except OSError as error:
                trouble = f"{error.strerror or error}: {self._path}"
            except ApiError as error:
                trouble = str(error)
            finally:
                self._close()
            yield FeedTrouble(self._gone() or trouble)
            await asyncio.sleep(RETRY_S)

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Reply:
        """Ask for ``ask`` now or never."""
        return await self._order(lambda client: client.ask(Request(ask, why), vehicle))

    async def control(self, *, take: bool) -> Reply:
        """Take control, or give it back."""
        return await self._order(lambda client: client.take_control() if take else client.give_control())

    async def set_gain(self, key: str, value: float) -> Reply:
        """Change a gain in flight."""
        return await self._order(lambda client: client.set_gains({key: value}))

    async def _order(self, order: Callable[[StationClient], Awaitable[OrderAnswer]]) -> Reply:
        if self._client is None:
            return Reply(done=False, says="NOT SENT: no ground station is there")
        try:
            answer = await order(self._client)
        except ApiError as error:
            return Reply(done=False, says=f"NO ANSWER, it may not have been heard: {error}")
        return Reply(answer.done, answer.says)

    def _close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()


def _holder(control: Control) -> Holder:
    return Holder(control.holder or "", control.yours)


SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
TURN_S = 0.1
"""How often it looks whether something is to be shown [s]."""
WIND_S = 5.0
"""So far one key winds [s]."""
NOBODY = Reply(done=False, says="a recording can't be asked for anything")


class Playback:
    """Implements :class:`groundstation.interfaces.tui.model.Feed`."""

    live = False

    def __init__(self, hello: FlightIdentity, snapshots: Sequence[Snapshot]) -> None:
        """Whom it is about, and the snapshots in their order; it begins at the first one, playing."""
        self._hello, self._snapshots = hello, snapshots
        self._times = [snapshot.time_s for snapshot in snapshots]
        self._at_s = self._times[0] if snapshots else 0.0
        self._speed = SPEEDS.index(1.0)
        self._wound = asyncio.Event()
        self.paused = False

    async def news(self) -> AsyncIterator[News]:
        """The snapshots as their time comes; where it was wound, also those before, for the plots."""
        loop = asyncio.get_running_loop()
        yield self._hello
        shown, last_s = 0, loop.time()
        while True:
            now = loop.time()
            if not self.paused:
                self._at_s += SPEEDS[self._speed] * (now - last_s)
            last_s = now
            if self._times and self._at_s >= self._times[-1]:
                self._at_s, self.paused = self._times[-1], True
            until = bisect_right(self._times, self._at_s)
            if self._wound.is_set():
                self._wound.clear()
                yield Jump()
                shown = max(0, until - KEPT)
            for snapshot in self._snapshots[shown:until]:
                yield snapshot
            shown = max(shown, until)
            try:
                async with asyncio.timeout(TURN_S):
                    await self._wound.wait()
            except TimeoutError:
                pass

    def steer(self, what: str) -> None:
        """``pause`` (and on again), ``back``, ``on``, ``start``, ``slower`` or ``faster``."""
        match what:
            case "pause":
                if self.paused and self._times and self._at_s >= self._times[-1]:
                    self.seek(0.0)
                self.paused = not self.paused
            case "back" | "on":
                self.seek(self.passed_s + (WIND_S if what == "on" else -WIND_S))
            case "start":
                self.seek(0.0)
            case "slower" | "faster":
                self._speed = max(0, min(len(SPEEDS) - 1, self._speed + (1 if what == "faster" else -1)))

    def seek(self, passed_s: float) -> None:
        """Go on from ``passed_s`` after its beginning [s]."""
        if self._times:
            self._at_s = max(self._times[0], min(self._times[-1], self._times[0] + passed_s))
            self._wound.set()

    @property
    def passed_s(self) -> float:
        """Time since its beginning [s]."""
        return self._at_s - self._times[0] if self._times else 0.0

    def where(self) -> str:
        """For the operator: where it is, and how fast it goes."""
        whole = self._times[-1] - self._times[0] if self._times else 0.0
        pace = "stopped" if self.paused else f"×{SPEEDS[self._speed]:g}"
        return f"RECORDING {self.passed_s:.1f}/{whole:.1f} s {pace}"

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Reply:
        """Nothing flies."""
        del ask, why, vehicle
        return NOBODY

    async def control(self, *, take: bool) -> Reply:
        """Nothing flies."""
        del take
        return NOBODY

    async def set_gain(self, key: str, value: float) -> Reply:
        """Nothing flies."""
        del key, value
        return NOBODY


STEP_S = 0.1
"""Time between two snapshots [s]."""
_TICK = ("/command", "/reference", "/estimate", "/errors", "/adaptation", "/lyapunov", "/timing")
_TOPICS = (*_TICK, "/truth", "/measured", "/mission", "/switch", "/request", "/lost", "/link", "/source")
_LINK = LinkStatus(state="closed", sent=0, expired=0, received=0, dropped={}, text="")


T = TypeVar("T", LinkStatus, PoseStatus)


class _Error(msgspec.Struct):
    error_m: float | None


class _Late(msgspec.Struct):
    lateness_s: float | None = None


class Tape:
    """One recording, read once. What is not recorded is missing: V is without b̃, pre-flight checks are events."""

    def __init__(self, path: Path) -> None:
        """Look at the beginning.

        Raises:
            NoRecording, OSError: see :class:`groundstation.recording.reader.Recording`.
        """
        self._recording = Recording(path)
        about = self._recording.about
        self.hello = FlightIdentity(about.get("vehicle", "?"), f"recording {path.name}", about.get("config", ""))
        try:
            config = parse_toml(self.hello.config)
        except ValueError:
            config = {}
        vehicle = config.get("vehicle", {})
        self._thrust_max_n = float(vehicle.get("thrust_max_n", math.nan))
        limits = vehicle.get("rate_limits_deg_s", ())
        self._limits = _triple([math.radians(one) for one in limits]) if len(limits) == 3 else None
        self._state = self._reason = ""
        self._events: deque[str] = deque(maxlen=20)
        self._parts: dict[str, bytes] = {}
        self._arrivals: deque[float] = deque(maxlen=1000)
        self._steady, self._true = SteadyError(), SteadyError()
        self._lateness = Lateness()
        controller = config.get("controller", {})
        named = {name: controller.get(name) for name in LIVE}
        self._gains = {PREFIX + name: float(value) for name, value in named.items() if value is not None}

    def snapshots(self) -> Iterator[PlayedSnapshot]:
        """From its beginning to its end, or to its damage."""
        shift: float | None = None
        due = now = -math.inf
        for entry in self._recording.entries(_TOPICS):
            if shift is None:
                told = entry.value()
                shift = float(told.get("time_s", told.get("arrival_s", 0.0))) - 1e-9 * entry.stamp_ns
            now = 1e-9 * entry.stamp_ns + shift
            if now >= due:
                if due > -math.inf:
                    yield self._snapshot(now)
                due = now + STEP_S
            self._take(entry, now)
        if due > -math.inf:
            yield self._snapshot(now)

    def _take(self, entry: Entry, now: float) -> None:
        self._parts[entry.topic] = entry.data
        match entry.topic:
            case "/measured":
                self._arrivals.append(now)
            case "/timing":
                late = msgspec.json.decode(entry.data, type=_Late).lateness_s
                if late is not None:
                    self._lateness.add(late)
            case "/errors" | "/truth" if self._state == State.TRACKING:
                error = msgspec.json.decode(entry.data, type=_Error).error_m
                if error is not None:
                    steady = self._steady if entry.topic == "/errors" else self._true
                    steady.add(_number(self._part("/command"), "flight_time_s"), error)
            case "/mission":
                told = entry.value()
                if told["state"] != self._state:
                    self._state, self._reason = told["state"], told["text"]
                self._events.append(f"{now:.3f} {told['state']}: {told['text']}")
            case "/switch":
                told = entry.value()
                if told["what"].startswith(GAIN):
                    self._gains[PREFIX + told["what"].removeprefix(GAIN)] = told["values"][0]
            case "/request":
                told = entry.value()
                self._events.append(f"{now:.3f} asked to {told['what']}: {told['reason']}")
            case "/lost":
                self._events.append(f"{now:.3f} {entry.value()['count']} records are missing here")

    def _part(self, topic: str) -> dict[str, Any]:
        data = self._parts.get(topic)
        found: dict[str, Any] = {} if data is None else msgspec.json.decode(data)
        return found

    def _snapshot(self, now: float) -> PlayedSnapshot:
        command, reference, estimate, errors, adaptation, lyapunov, _ = (self._part(topic) for topic in _TICK)
        measured = self._part("/measured")
        here = estimate or measured
        source = _status(self._part("/source"), PoseStatus(accepted=0, dropped={}))
        attitude = here.get("attitude", {})
        w, x, y, z = (_number(attitude, key, default) for key, default in zip("wxyz", (1.0, 0, 0, 0), strict=True))
        quaternion: Quat = (w, x, y, z)
        while self._arrivals and self._arrivals[0] < now - 1.0:
            self._arrivals.popleft()
        return PlayedSnapshot(
            vehicle=self.hello.vehicle,
            state=self._state,
            reason=self._reason,
            time_s=now,
            flight_time_s=_number(command, "flight_time_s", 0.0),
            pose_id=int(measured.get("id", -1)),
            pose_age_s=now - _number(measured, "time_s", now),
            pose_rate_hz=float(len(self._arrivals)),
            poses_dropped=source.dropped,
            position_ned=_vector(here, "position_ned"),
            velocity_ned=_vector(estimate, "velocity_ned"),
            attitude=quaternion,
            reference_ned=_vector(reference or here, "position_ned"),
            error_m=_number(errors, "error_m", 0.0),
            rms_m=self._steady.rms_m or 0.0,
            thrust_n=_number(command, "thrust_n", 0.0),
            thrust_max_n=self._thrust_max_n,
            rates_rad_s=_vector(command, "rates_rad_s"),
            saturated=bool(command.get("saturated")),
            diagnostics=_diagnostics(errors, adaptation, lyapunov) if errors else None,
            link=_status(self._part("/link"), _LINK),
            events=tuple(self._events),
            rate_limits_rad_s=self._limits,
            thrust_effectiveness=_number(adaptation, "effectiveness", 1.0),
            certificate=_certificate(lyapunov) if lyapunov else None,
            pose_latency_s=source.latency_s,
            pose_latency_max_s=source.latency_max_s,
            pose_gaps=source.gaps,
            pose_clock_steps=source.clock_steps + source.clock_restarts,
            late_us=self._lateness.percentiles_us() if self._lateness.count else None,
            gains=dict(self._gains),
            late_octaves=tuple(self._lateness.octaves) if self._lateness.count else (),
            true_error_m=self._part("/truth").get("error_m"),
            true_rms_m=self._true.rms_m,
        )


def _diagnostics(errors: dict[str, Any], adaptation: dict[str, Any], lyapunov: dict[str, Any]) -> Diagnostics:
    return Diagnostics(
        z1=_vector(errors, "z1_m"),
        z2=_vector(errors, "z2_m_s"),
        z3=_vector(errors, "z3_m_s2"),
        u_star=_vector(errors, "u_star_m_s2"),
        b_hat=_vector(adaptation, "b_hat_m_s2"),
        b_hat_dot=_vector(adaptation, "b_hat_dot_m_s3"),
        disturbance=_vector(adaptation, "d_hat_m_s2"),
        v_terms=_triple([_number(lyapunov, key) for key in ("v_sigma", "v_omega", "v_z3")]),
        w_terms=_triple([_number(lyapunov, key) for key in ("w_sigma", "w_rho", "w_z3")]),
        v_known=_number(lyapunov, "v_known"),
        w=_number(lyapunov, "w"),
        certificate=str(lyapunov.get("certificate", "none")),
    )


def _certificate(lyapunov: dict[str, Any]) -> Certificate:
    return Certificate(
        state=str(lyapunov["state"]),
        bound=str(lyapunov["certificate"]),
        v=_number(lyapunov, "v_known"),
        excess=_number(lyapunov, "excess"),
        violated_fraction=math.nan,
        suspended_fraction=math.nan,
        b_hat_fraction=None,
    )


def _status(part: dict[str, Any], otherwise: T) -> T:
    try:
        return msgspec.convert(part["status"], type(otherwise))
    except (KeyError, msgspec.ValidationError):
        return otherwise


def _number(part: dict[str, Any], key: str, otherwise: float = math.nan) -> float:
    """JSON knows no NaN: null is one."""
    value = part.get(key, otherwise)
    return math.nan if value is None else float(value)


def _vector(part: dict[str, Any], key: str) -> Vec3:
    value = part.get(key)
    return (0.0, 0.0, 0.0) if value is None else _triple([_number(value, axis) for axis in "xyz"])


def _triple(values: list[float]) -> Vec3:
    a, b, c = values
    return a, b, c
