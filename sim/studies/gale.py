"""Gale study: what published laws do in a wind tunnel that was built of published logs, beside what was measured there.

Three published laws, as recovered from their logged commands, fly in five winds through the attitude set-point loop and
the thrust of :mod:`sim.scenarios.gale`, at 50 Hz, side by side in arrays; z is up. The same table without aerodynamics
says how much power the test has, as most of the agreement comes from the recovered gains.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.core.messages import Notice, Tick
from groundstation.core.vehicle import GRAVITY
from groundstation.machine import replace_between_markers, split_at_markers
from groundstation.runtime import Exit
from sim.runs import TrueTrack, fly
from sim.scenarios import SCENARIOS, gale, prepare

Column = NDArray[np.float64]

LAWS = ("pid", "indi", "l1")
"""PID baseline, incremental dynamic inversion, L1 adaptation."""
STEP_S = 0.0025
"""Step of the integration [s]."""
PERIOD_S = 1.0 / gale.POSE_HZ
"""Time between two poses [s]."""
VELOCITY_NOISE_M_S = 2e-3
"""Velocity noise of their motion capture's filter [m/s]; not in the logs, and without weight in the result."""
CLOSE = 0.3
"""A figure is given back if it lies within this share of the measured one."""
HEADS = ("calm", "4.2 m/s", "8.5 m/s", "8.5 + 2.2 sin(t + 5) m/s", "12.1 m/s")


class RecoveredLaw(NamedTuple):
    """u = a_d - p e - d ė - i ∫e - g LP(f): f is the measured force over the mass, filtered below ``low_rad_s``."""

    p: tuple[float, float, float]
    d: tuple[float, float, float]
    i: float
    g: float
    low_rad_s: tuple[float, float, float]


RECOVERED = {
    "pid": RecoveredLaw((3.0, 3.0, 3.0), (4.0, 4.0, 3.0), 1.0, 0.0, (5.0, 5.0, 5.0)),
    "indi": RecoveredLaw((3.0, 3.0, 2.5), (4.0, 4.0, 0.5), 0.0, 1.0, (5.0, 5.0, 7.5)),
    "l1": RecoveredLaw((3.0, 3.0, 3.0), (4.0, 4.0, 3.0), 0.0, 0.9, (5.5, 5.5, 5.0)),
}


class PublishedFlight(msgspec.Struct, frozen=True, kw_only=True):
    """One law in one wind: medians over the seeds."""

    law: str
    wind: str
    rms_cm: float
    measured_cm: float
    offset_x_cm: float
    """Mean error in x."""
    lead_z_ms: float
    """Lead of z over its reference [ms]."""

    @property
    def close(self) -> bool:
        """Whether the measured figure is given back."""
        return abs(self.rms_cm / self.measured_cm - 1.0) <= CLOSE


class _AttitudeLag:
    """The autopilots' attitude: roll and pitch [rad] follow their set-points as second-order lags."""

    def __init__(self, roll: Column, pitch: Column) -> None:
        """At rest."""
        self.roll, self.pitch = roll, pitch
        self._roll_rate, self._pitch_rate = np.zeros_like(roll), np.zeros_like(pitch)

    def step(self, roll: Column, pitch: Column) -> None:
        """``STEP_S`` under these set-points [rad]."""
        w, damps = gale.ATTITUDE_RAD_S, 2.0 * gale.ATTITUDE_DAMPING * gale.ATTITUDE_RAD_S
        self._roll_rate = self._roll_rate + STEP_S * (w * w * (roll - self.roll) - damps * self._roll_rate)
        self._pitch_rate = self._pitch_rate + STEP_S * (w * w * (pitch - self.pitch) - damps * self._pitch_rate)
        self.roll, self.pitch = self.roll + STEP_S * self._roll_rate, self.pitch + STEP_S * self._pitch_rate

    def axes(self) -> tuple[Column, Column, Column]:
        """Where the body's x, y and z (up) point, each (n, 3)."""
        s, c, t, d = np.sin(self.roll), np.cos(self.roll), np.sin(self.pitch), np.cos(self.pitch)
        return (
            np.stack([d, 0.0 * s, -t], axis=1),
            np.stack([t * s, c, d * s], axis=1),
            np.stack([t * c, -s, d * c], axis=1),
        )


class _Tunnel:
    """Every flight at once: bodies, attitudes, thrust and air."""

    def __init__(self, winds: Sequence[str], seeds: Sequence[int], *, aerodynamics: bool) -> None:
        some = [gale.WINDS[name] for name in winds]
        self.n = len(some)
        scale = 1.0 if aerodynamics else 0.0
        self._speed = scale * np.array([-one.speed_m_s for one in some])
        self._gust = scale * np.array([-one.gust_m_s for one in some])
        self._gain = np.array([one.gain if aerodynamics else 1.0 for one in some])
        self._pitch = scale * gale.PITCH_PER_M_S * np.array([one.speed_m_s > 0.0 for one in some])
        self.jitter = np.array([one.jitter_s for one in some])
        self._aero, self._bias, self._sigma = scale, scale * np.array(gale.BIAS_N), scale * np.array(gale.REST_N)
        index = list(gale.WINDS)
        self.draws = [np.random.default_rng([seed, index.index(name)]) for name, seed in zip(winds, seeds, strict=True)]
        self.position = np.tile(gale.course(0.0)[0], (self.n, 1))
        self.velocity = np.zeros((self.n, 3))
        self._rest = self._sigma * self.normal(3)
        gust, self._gust = self._gust, 0.0 * self._gust
        self._still = self._trim()[0].pitch
        self._gust = gust
        self.attitude, self._thrust = self._trim()
        self.command = 1.0 + (self._thrust / GRAVITY - 1.0) / gale.THRUST_SLOPE
        self._late = [self.command] * round(gale.THRUST_DELAY_S / STEP_S)

    def normal(self, columns: int) -> Column:
        """Standard normal numbers, (n, columns): those of a wind and a seed are the same for every law."""
        return np.stack([draw.standard_normal(columns) for draw in self.draws])

    def _force(self, time_s: float, attitude: _AttitudeLag) -> Column:
        """Compute the air's force without its random part [N], (n, 3)."""
        air = self.velocity.copy()
        air[:, 0] -= self._speed + self._gust * np.sin(time_s + gale.GUST_PHASE)
        axes = attitude.axes()
        x, y, z = ((air * axis).sum(axis=1) for axis in axes)
        inflow = np.hypot(x, y)
        plane = -(gale.DRAG + gale.DRAG_INFLOW * inflow)
        up = -(gale.SINK_DRAG + gale.SINK_INFLOW * inflow) * z + gale.LIFT * inflow**2
        parts = zip((plane * x, plane * y, up), axes, strict=True)
        force: Column = self._aero * np.sum([part[:, None] * axis for part, axis in parts], axis=0) + self._bias
        return force

    def _trim(self) -> tuple[_AttitudeLag, Column]:
        """Attitude and specific force that stand still in the wind of the start."""
        attitude = _AttitudeLag(np.zeros(self.n), np.zeros(self.n))
        need = np.zeros((self.n, 3))
        for _ in range(200):
            need = np.array([0.0, 0.0, GRAVITY]) - self._force(0.0, attitude) / gale.MASS_KG
            attitude = _AttitudeLag(*lean(need))
        return attitude, np.linalg.norm(need, axis=1)

    def step(self, time_s: float, roll: Column, pitch: Column) -> None:
        """``STEP_S`` under these set-points of the attitude, and :attr:`command`, thrust over that of hover."""
        self._late.append(self.command)
        wanted = GRAVITY * (1.0 + gale.THRUST_SLOPE * (self._late.pop(0) - 1.0))
        self._thrust = self._thrust + (1.0 - np.exp(-STEP_S / gale.THRUST_LAG_S)) * (wanted - self._thrust)
        pitch = self._still + self._gain * (pitch - self._still) + self._pitch * self.velocity[:, 2]
        self.attitude.step(roll, pitch)
        force = self._force(time_s, self.attitude) + self._rest
        pushed = self._thrust[:, None] * self.attitude.axes()[2] + force / gale.MASS_KG
        self.velocity = self.velocity + STEP_S * (pushed - np.array([0.0, 0.0, GRAVITY]))
        self.position = self.position + STEP_S * self.velocity
        keep = float(np.exp(-STEP_S / gale.REST_S))
        if self._aero:
            self._rest = keep * self._rest + np.sqrt(1.0 - keep * keep) * self._sigma * self.normal(3)


def lean(push: Column) -> tuple[Column, Column]:
    """Roll and pitch that bring the thrust along ``push`` (n, 3)."""
    along = push / np.linalg.norm(push, axis=1, keepdims=True)
    return -np.arcsin(np.clip(along[:, 1], -1.0, 1.0)), np.arctan2(along[:, 0], along[:, 2])


def fly_published(seeds: int = 5, *, aerodynamics: bool = True) -> list[PublishedFlight]:
    """Every law in every wind; without ``aerodynamics`` the null model: neither wind nor drag nor what goes with it."""
    cases = [(law, wind, seed) for law in LAWS for wind in gale.WINDS for seed in range(seeds)]
    tunnel = _Tunnel([wind for _, wind, _ in cases], [seed for *_, seed in cases], aerodynamics=aerodynamics)
    p, d, low = (np.array([getattr(RECOVERED[law], part) for law, *_ in cases]) for part in ("p", "d", "low_rad_s"))
    i, g = (np.array([[getattr(RECOVERED[law], part)] for law, *_ in cases]) for part in ("i", "g"))
    down = np.array([0.0, 0.0, GRAVITY])
    force = down - GRAVITY * tunnel.command[:, None] * tunnel.attitude.axes()[2]  # what it seems to be, in trim
    sums, before = force.copy(), tunnel.velocity
    roll, pitch = tunnel.attitude.roll, tunnel.attitude.pitch
    keep = 1.0 - np.exp(-low * PERIOD_S)
    places, wanted = [], []
    for k in range(round(gale.LENGTH_S / PERIOD_S)):
        place, speed, acceleration = (np.array(part) for part in gale.course(k * PERIOD_S))
        noise = tunnel.normal(7)
        seen = tunnel.position + tunnel.jitter[:, None] * noise[:, :1] * tunnel.velocity
        seen = seen + gale.POSE_NOISE_M * noise[:, 1:4]
        moving = tunnel.velocity + VELOCITY_NOISE_M_S * noise[:, 4:7]
        measured = (moving - before) / PERIOD_S if k else np.zeros_like(moving)
        before = moving
        seems = measured + down - GRAVITY * tunnel.command[:, None] * tunnel.attitude.axes()[2]
        force = force + keep * (seems - force)
        error = seen - place
        sums = sums + PERIOD_S * error
        push = acceleration - p * error - d * (moving - speed) - i * sums - g * force + down
        roll, pitch = lean(push)
        tunnel.command = np.linalg.norm(push, axis=1) / GRAVITY
        for step in range(round(PERIOD_S / STEP_S)):
            tunnel.step(k * PERIOD_S + step * STEP_S, roll, pitch)
        if (k + 1) * PERIOD_S >= gale.JUDGED_S:
            places.append(tunnel.position)
            wanted.append(gale.course((k + 1) * PERIOD_S)[0])
    flown, asked = np.array(places), np.array(wanted)[:, None]
    off = flown - asked
    rms = 100.0 * np.sqrt((off**2).sum(axis=2).mean(axis=0))
    offset, lead = 100.0 * off[:, :, 0].mean(axis=0), _lead_ms(flown[:, :, 2], asked[:, 0, 2])
    found = []
    for law in LAWS:
        for wind, facts in gale.WINDS.items():
            own = [k for k, case in enumerate(cases) if case[:2] == (law, wind)]
            middle = [median(figure[own].tolist()) for figure in (rms, offset, lead)]
            found.append(
                PublishedFlight(
                    law=law, wind=wind, rms_cm=middle[0], measured_cm=facts.measured_cm[law],
                    offset_x_cm=middle[1], lead_z_ms=middle[2],
                )
            )  # fmt: skip
    return found


def _lead_ms(height: Column, asked: Column) -> Column:
    """Estimate the lead of each column of ``height`` (N, n) over ``asked`` (N,) by the likeliest shift [ms]."""
    shifts = range(-15, 26)
    inner = slice(30, len(asked) - 30)
    centred = height[inner] - height[inner].mean(axis=0)
    likely = np.array([asked[30 + k : len(asked) - 30 + k] @ centred for k in shifts])
    lead: Column = 1e3 * PERIOD_S * np.array(shifts)[likely.argmax(axis=0)]
    return lead


_SHORT, _LONG = (
    (f"vehicle.thrust_lag_s={gale.THRUST_LAG_S + off:g}", f"vehicle.rate_lag_s={1.0 / gale.ATTITUDE_RAD_S + off:g}")
    for off in (-0.02, 0.02)
)
WRONG = {
    "told right": (),
    "lags and delay told 20 ms too short": (*_SHORT, "sim.command_delay_s=0.02"),
    "lags and delay told 20 ms too long": (*_LONG, "vehicle.command_delay_s=0.02"),
    "lags told 20 ms too short": _SHORT,
    "delay told 20 ms too short": ("sim.command_delay_s=0.02",),
}
"""Lags and delay as our controller is configured, beside the truth; where they are wrong,"""
ROUGH = ("sim.pose_jitter_s=0.001", f"sim.wind_turbulence={0.5 / gale.MASS_KG:g}")
"""stamps are 1 ms off, and there is further turbulence of 0.5 N."""
SHARES = (0.6, 0.75)
"""Limits as shares of Neural-Fly's figure [-]: configured right, and wrong."""


class OurFlight(msgspec.Struct, frozen=True, kw_only=True):
    """Ours in one wind: the median of the seeds, none where one of them was lost."""

    told: str
    wind: str
    rms_cm: float | None
    most_cm: float
    """Limit of the error [cm]."""
    lost: list[str]
    """Why flights ended, or what a guard said in them."""


def fly_ours(told: str, wind: str, seeds: int) -> OurFlight:
    """The vehicle's flights by this program, on body rates and thrust, through the bytes of its wires."""
    flown = [_fly_our_own(wind, [*WRONG[told], *(ROUGH if WRONG[told] else ())], seed) for seed in range(seeds)]
    lost = [why for _, why in flown if why]
    most = SHARES[bool(WRONG[told])] * gale.WINDS[wind].measured_cm["neural-fly"]
    middle = None if lost else median(rms_cm for rms_cm, _ in flown)
    return OurFlight(told=told, wind=wind, rms_cm=middle, most_cm=most, lost=lost)


def _fly_our_own(wind: str, overrides: list[str], seed: int) -> tuple[float, str]:
    """RMS error [cm], and why it does not count: why it ended early, or what a guard said."""
    world, config = prepare(SCENARIOS[wind], overrides)
    track, begun, flown_s = TrueTrack(), 0.0, 0.0
    said: list[str] = []

    def on_tick(tick: Tick) -> None:
        nonlocal begun, flown_s
        begun, flown_s = tick.estimate.time_s - tick.flight_time_s, tick.flight_time_s

    def on_event(event: Notice) -> None:
        # Of neither the beginning nor the end; it is no guard's answer that V warns of what is told wrongly, or that
        # it is found.
        if 1.0 < flown_s < gale.LENGTH_S - 1.0 and event.kind not in ("certificate", "latency"):
            said.append(event.line)

    result = fly(
        world, config, seed=seed, duration_s=gale.LENGTH_S, on_tick=on_tick, on_event=on_event, on_step=track.step
    )
    errors = track.errors(config.trajectory.build(), begun, begun + gale.JUDGED_S) or [math.inf]
    return 100.0 * float(np.sqrt(np.mean(np.square(errors)))), "; ".join(said) if result.completed else result.why


def _tabulate_ours(flown: Sequence[OurFlight], seeds: int) -> list[str]:
    lines = ["", "| ours, RMS, cm (at most) | " + " | ".join(HEADS) + " |", "|---" * 6 + "|"]
    for told in WRONG:
        cells = [
            f"{'lost' if one.rms_cm is None else f'{one.rms_cm:.1f}'} ({one.most_cm:.1f})"
            + ("" if one.rms_cm is not None and one.rms_cm <= one.most_cm else " ✗")
            for one in flown
            if one.told == told
        ]
        lines.append(f"| {told} | " + " | ".join(cells) + " |")
    neural = [f"{facts.measured_cm['neural-fly']:g}" for facts in gale.WINDS.values()]
    return [
        *lines,
        "| *Neural-Fly, flown* | " + " | ".join(neural) + " |",
        "",
        f"Medians of {seeds} seed{'s' if seeds > 1 else ''}, in brackets 0.6 times Neural-Fly's figure (0.75 where "
        "told wrong, with stamps 1 ms off and 0.5 N of turbulence besides).",
        "**Simulated, on body rates and thrust, against flown, on attitude set-points. Simulation under-reads adaptive "
        "flights by up to 30 %.**",
    ]


def gale_command(write: Path | None, seeds: int, ours: int, *, as_json: bool) -> Exit:
    """Print what the published laws do in the tunnel, and the null model; 1 where it is not what was measured.

    With ``ours`` > 0 so many flights of this program in each wind come after them.

    Raises:
        ConfigError: ``write`` can't be written, or has no markers.
    """
    if write is not None:
        split_at_markers(write, "gale")  # before minutes go by
    flown, null = fly_published(seeds), fly_published(seeds, aerodynamics=False)
    own = [fly_ours(told, wind, ours) for told in WRONG for wind in gale.WINDS] if ours else []
    lines = [*_table(flown, null, seeds), *(_tabulate_ours(own, ours) if own else ())]
    facts = {
        "ours": msgspec.to_builtins(own),
        "flights": [{**msgspec.to_builtins(one), "close": one.close} for one in flown],
        "close": sum(one.close for one in flown),
        "null_close": sum(one.close for one in null),
        "of": len(flown),
    }
    if write is not None:
        replace_between_markers(write, "\n".join(lines), "gale")
        print(f"{write} written")
    elif as_json:
        print(json.dumps(facts))
    else:
        print("\n".join(lines))
    return Exit.DONE if len(flown) - 2 <= sum(one.close for one in flown) else Exit.FAILED


def _table(flown: Sequence[PublishedFlight], null: Sequence[PublishedFlight], seeds: int) -> list[str]:
    def row(name: str, cells: Sequence[Any]) -> str:
        return " | ".join([f"| {name}", *map(str, cells)]) + " |"

    lines = [row("RMS, cm: tunnel (measured)", HEADS), "|---" * 6 + "|"]
    names = {"pid": "PID baseline", "indi": "INDI", "l1": "L1"}
    for law in LAWS:
        own = [one for one in flown if one.law == law]
        lines.append(
            row(names[law], [f"{one.rms_cm:.1f} ({one.measured_cm:g}){'' if one.close else ' ✗'}" for one in own])
        )
    for law in LAWS:
        own = [one for one in null if one.law == law]
        lines.append(row(f"{names[law]}, without aerodynamics", [f"{one.rms_cm:.1f}" for one in own]))
    by = {(one.law, one.wind): one for one in flown}
    offsets = {law: [by[law, wind].offset_x_cm for wind in gale.WINDS] for law in LAWS}
    stands = ", ".join(f"{abs(x):.1f}" for x in offsets["l1"][2:])
    leads = [by["pid", wind].lead_z_ms for wind in gale.WINDS]
    close, nothing = (sum(one.close for one in some) for some in (flown, null))
    lines += [
        "",
        f"Medians of {seeds} seeds; ✗: more than 30 % off. **{close} of {len(flown)}** are given back within 30 %, and "
        f"{nothing} of {len(flown)} by the same laws without any aerodynamics, so most of it comes from the recovered "
        "gains, and the test has power over the rest.",
        f"Structure: the baseline's height leads its reference by {min(leads):.0f} to {max(leads):.0f} ms "
        f"(flown: 50 to 150); L1 stands {stands} cm off in x at 8.5 m/s and above "
        f"(flown: 9.4, 9.4, 19.0), the baseline at most {max(map(abs, offsets['pid'])):.1f} cm and INDI "
        f"{max(map(abs, offsets['indi'])):.1f} cm (flown: under 3).",
    ]
    return lines
