"""Evidence, ``groundstation replay evidence FLIGHT…``: how well our estimator predicts a flight.

At each pose of the part that flies, the estimator has seen the poses up to then and the commands
that had been sent; it says where the vehicle will be, and the pose that is measured then is the
judge. Beside it stand constant velocity (over 50 ms) and constant acceleration (over 100 ms).
Positions alone are judged, and a velocity that the source tells is held against them.

The filter's noise is that of the source: the likeliest of what its positions show beside the thrust
that was commanded, or, without commands, beside the thrust that carries the weight as the vehicle
leans. An attitude set-point becomes body rates by the gain of the autopilot's attitude loop
(mapping), about the measured attitude.
"""

import json
import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from groundstation.analysis.evidence.flight import (
    IMPORTED,
    MEASURED,
    Column,
    ImportedSetpoint,
    ImportedState,
    MappedVehicle,
)
from groundstation.analysis.evidence.imports import describe_import, load_mapping, read_flight
from groundstation.analysis.identify import (
    LEAST_S,
    POSE_GAP_S,
    SETTLING_S,
    FlightStretch,
    StretchTooShort,
    find_noise,
    find_stretch,
    identify,
    respond_with_lag,
)
from groundstation.config import ConfigError, from_dict
from groundstation.core.estimation import (
    LOST_INTERVALS,
    NOISE_FLOOR_M2,
    Estimation,
    ModelEstimator,
    fourth_difference,
    split_noise,
)
from groundstation.core.geometry import arrays, so3
from groundstation.core.messages import Pose, notice
from groundstation.core.vehicle import GRAVITY, ActuatorCommand
from groundstation.recording import MeasuredMessage, Recording, read_pose, refuse_recordings
from groundstation.runtime import Exit
from groundstation.settings import Config, read_flown_config
from links.core import signal, thrust

HORIZONS_MS = (20, 40, 60, 100)
"""Times ahead at which predictions are judged [ms]."""
NEAR = 0.25
"""The pose that judges a prediction lies within this share of its horizon."""
BASE_S = 0.05
"""Constant velocity is the mean over this time [s]; constant acceleration takes twice as long."""
LIFTED_M = 0.2
"""A vehicle that begins, or ends, on the floor flies while it is this far above it [m]."""
STANDS_S = 0.5
"""Time within which a standing vehicle keeps its height [s]."""
STANDS_M = 0.003
"""Largest range of its height in that time, and of all such means where it never flew [m]."""
LEAST_FLOWN_S = 3.0
"""A shorter hop tells nothing [s]."""
LEAST_POSES = 50
"""Fewer poses tell nothing [-]."""
LEAST_UPRIGHT = 0.5
"""Nobody leans further than 60° without falling: cosine of the angle from upright [-]."""
IDENTIFIED_S = 180.0
"""Length of a flight used for identification [s]: its fits take longer than all judging."""


@dataclass(frozen=True)
class EvidenceFlight:
    """A flight as its recording has it, and what was known of its vehicle."""

    path: Path
    source: str
    poses: list[Pose]
    may_fly: list[bool]
    sent: list[ImportedSetpoint]
    hover: float | None
    """Thrust signal that hovers, where the source told."""
    told: MappedVehicle
    config: Config | None
    """Configuration of our own controller, or the given one; None for other flights of others."""
    left_out: dict[str, int]
    """Number of entries changed or left out at the import, by reason."""
    own: bool
    """Whether this program flew it."""
    trouble: str
    """Why the rest of the recording is not here, as ``Recording.trouble``; empty where all is."""


def load_flight(path: Path, config: Config | None = None) -> EvidenceFlight:
    """The flight in ``path``: a recording of ours, an imported one, or a .tlog.

    ``config`` describes the vehicle of others; without it the flight itself does.

    Raises:
        ConfigError: it is none, or holds too few poses.
    """
    trouble = ""
    if path.suffix != ".tlog":
        with refuse_recordings():
            recording = Recording(path)
            about = recording.about
            if "imported" in about:
                messages = list(_decode(recording))
            else:
                config = read_flown_config(about, path).config
                messages = list(_translate(recording, config))
            trouble = recording.trouble
    else:
        mapping = load_mapping("ardupilot-tlog")
        imported = read_flight(mapping, [path])
        about = describe_import(imported, mapping, "ardupilot-tlog", [path])
        messages = [message for _, _, message in imported.messages]
    own = "imported" not in about
    poses, flags, sent = _sort_messages(messages, may_fly=not own)
    if len(poses) < LEAST_POSES:
        short = f"; the recording {trouble}" if trouble else ""
        says = notice("evidence.few_poses", count=len(poses), least=LEAST_POSES, short=short)
        raise ConfigError("FLIGHT", says, str(path))
    told = MappedVehicle()
    if not own:
        told = msgspec.json.decode(about["vehicle_told"], type=MappedVehicle)
    source = about.get("source", "simulation" if about.get("scenario") else "our own")
    left_out = msgspec.json.decode(about.get("notes", "{}"), type=dict[str, int])
    hover = float(about["hover"]) if about.get("hover") else None
    return EvidenceFlight(
        path, source, poses, flags, sent, hover, told, config, left_out, own, trouble
    )


def _sort_messages(
    messages: list[Any], *, may_fly: bool
) -> tuple[list[Pose], list[bool], list[ImportedSetpoint]]:
    """The poses, whether each may be flying (at first ``may_fly``), and the set-points."""
    poses, flags, sent = list[Pose](), list[bool](), list[ImportedSetpoint]()
    for message in messages:
        match message:
            case MeasuredMessage():
                poses.append(read_pose(message))
                flags.append(may_fly)
            case ImportedSetpoint():
                sent.append(message)
            case ImportedState():
                may_fly = message.may_fly
    return poses, flags, sent


def _decode(recording: Recording) -> Iterator[Any]:
    """Messages of an imported recording."""
    for entry in recording.entries(IMPORTED):
        yield msgspec.json.decode(entry.data, type=IMPORTED[entry.topic][1])


def _translate(recording: Recording, config: Config) -> Iterator[Any]:
    """Messages of our own recording, as an import would have them."""
    for entry in recording.entries((MEASURED, "/command", "/idle")):
        message = entry.message()
        if entry.topic == MEASURED:
            yield message
            continue
        yield ImportedState(message.time_s, entry.topic == "/command")
        share = signal(message.thrust_n / config.full_thrust_n, config.thrust_curve)
        yield ImportedSetpoint(message.time_s, share, message.rates_rad_s)


class PoseNoise(NamedTuple):
    """Noise of the poses that move, by what no smooth motion explains of five in a row."""

    along_m: float
    """Along the motion, where wrong stamps add their share [m]."""
    across_m: float
    """Across it, per axis [m]."""
    jitter_s: float
    """Error of the stamps, 1σ: that share over the speed [s]."""


def measure_pose_noise(at_s: Column, place: Column) -> PoseNoise:
    """Measure the noise of positions (N, 3) [m] at ``at_s`` (N,) [s]."""
    last = len(at_s) - 4
    times: Any = [at_s[k : last + k] for k in range(5)]
    fives: Any = [tuple(place[k : last + k].T) for k in range(5)]
    variance, along, way2 = fourth_difference(times, fives)
    span_s = times[4] - times[0]
    whole = span_s < LOST_INTERVALS * np.median(span_s)
    noise2, along2, speed2 = (
        float(np.mean(of, where=whole)) for of in (variance, along, way2 / span_s**2)
    )
    across2, jitter2 = split_noise(arrays(), noise2, (along2, speed2), NOISE_FLOOR_M2, None)
    return PoseNoise(math.sqrt(along2), math.sqrt(float(across2)), math.sqrt(float(jitter2)))


def find_airborne(at_s: Column, place: Column, may_fly: Sequence[bool]) -> slice:
    """The poses from the first to the last that fly, without those on the floor."""
    first, end = 0, len(at_s)
    if any(may_fly):
        first, end = may_fly.index(True), len(may_fly) - list(may_fly)[::-1].index(True)
    up = -place[:, 2]
    window = max(5, int(STANDS_S / max(float(np.median(np.diff(at_s))), 1e-3)))

    def count_standing(heights: Column) -> int:
        """Count the ``heights`` before it leaves the floor; 0 where it did not stand."""
        stand = heights[:window]
        off = np.flatnonzero(heights > float(np.median(stand)) + LIFTED_M)
        return int(off[0]) if float(np.ptp(stand)) < STANDS_M and len(off) else 0

    before, after = count_standing(up[first:end]), count_standing(up[first:end][::-1])
    return slice(first + before, end - after)


def why_not_judged(flight: EvidenceFlight, at_s: Column, place: Column) -> str:
    """Why nothing can be said of the part that should fly, at ``place`` (N, 3) [m].

    Empty where it can.
    """
    if not any(flight.may_fly):
        return notice("evidence.grounded").text
    window = max(1, int(STANDS_S / float(np.median(np.diff(at_s)))))
    means = place[: len(place) // window * window].reshape(-1, window, 3).mean(axis=1)
    if len(means) > 1 and float(np.ptp(means, axis=0).max()) < STANDS_M:
        return notice("evidence.stands").text
    flown_s = float(at_s[-1] - at_s[0])
    return (
        ""
        if flown_s >= LEAST_FLOWN_S
        else notice("evidence.short", flown_s=flown_s, least_s=LEAST_FLOWN_S).text
    )


@dataclass(frozen=True)
class DrivenFlight:
    """A flight with its commands as thrust and body rates, at the instants they left."""

    flight: EvidenceFlight
    poses: list[Pose]
    """Without their velocity: the filter is judged by positions, and it may not be theirs."""
    air: slice
    """Poses that fly."""
    at_s: Column
    place: Column
    """Positions [m], as they would have been had their origin never moved."""
    commands: list[tuple[float, ActuatorCommand]]
    """When each left [s], and its thrust [N] and rates [rad/s]; where none are known, what carries
    and turns the vehicle as it leaned and turned."""
    config: Config
    """Configuration of the filter."""


def join_origins(at_s: Column, place: Column, resets: Sequence[int]) -> Column:
    """Positions (N, 3) [m] as they would have been, had their origin never moved: where it did,
    velocity goes on.
    """
    step, joined = np.diff(place, axis=0), np.zeros_like(place)
    for k in (np.flatnonzero(np.diff(resets)) + 1).tolist():
        before = step[k - 2] / (at_s[k - 1] - at_s[k - 2]) if k > 1 else 0.0
        joined[k:] += before * (at_s[k] - at_s[k - 1]) - step[k - 1]
    return place + joined


def drive_flight(flight: EvidenceFlight, overrides: Sequence[str] = ()) -> DrivenFlight:
    """Find the part that flies, and what drives it there.

    ``overrides`` (``--set``) are of a vehicle of others.

    Raises:
        ConfigError: hardly anything of it flies, or an override is bad.
    """
    at_s = np.array([pose.time_s for pose in flight.poses])
    place = np.array([pose.position_ned for pose in flight.poses])
    place = join_origins(at_s, place, [pose.reset_count for pose in flight.poses])
    air = find_airborne(at_s, place, flight.may_fly)
    count = air.stop - air.start
    if count < LEAST_POSES:
        raise ConfigError(
            "FLIGHT", notice("evidence.few_flown", count=count, least=LEAST_POSES), str(flight.path)
        )
    upright = np.array(
        [max(so3.third_column(pose.attitude)[2], LEAST_UPRIGHT) for pose in flight.poses]
    )
    sent_s, signals, rates = _turn_commands(flight, at_s)
    curve = flight.config.thrust_curve if flight.config else flight.told.thrust_curve
    shares = (
        NOMINAL_HOVER / upright
        if signals is None
        else np.array([thrust(u, curve) for u in signals.tolist()])
    )
    hover = (
        thrust(flight.hover, curve)
        if flight.hover is not None
        else _find_hover(sent_s, shares, at_s[air])
    )
    if flight.sent and not flight.own:
        carried = np.flatnonzero(_average(sent_s, shares, at_s[air]) >= CARRIES * hover)
        if len(carried) >= LEAST_POSES:
            air = slice(air.start + int(carried[0]), air.start + int(carried[-1]) + 1)
    config = flight.config or _configure(flight.told, hover, sent_s, overrides)
    commands = [
        (time_s, ActuatorCommand(config.full_thrust_n * share, (x, y, z)))
        for time_s, share, (x, y, z) in zip(
            sent_s.tolist(), shares.tolist(), rates.tolist(), strict=True
        )
    ]
    poses = [msgspec.structs.replace(pose, velocity_ned=None) for pose in flight.poses]
    return DrivenFlight(flight, poses, air, at_s, place, commands, config)


CARRIES = 0.85
"""A vehicle in the air carries its weight: over one second the mean thrust is at least this share
of hover [-]. With less it would gain 1.5 m/s downwards in that second; one that stands on the
ground is far below."""


def _average(sent_s: Column, shares: Column, at_s: Column) -> Column:
    """Mean of the thrust ``shares`` that left at ``sent_s`` over the second around each time
    ``at_s`` [s].
    """
    total = np.concatenate([[0.0], np.cumsum(shares[:-1] * np.diff(sent_s))])
    begin, end = (np.clip(at_s + part, sent_s[0], sent_s[-1]) for part in (-0.5, 0.5))
    mean: Column = (np.interp(end, sent_s, total) - np.interp(begin, sent_s, total)) / np.maximum(
        end - begin, 1e-3
    )
    return mean


def _find_hover(sent_s: Column, shares: Column, at_s: Column) -> float:
    """The share of full thrust that carries it: the usual one while it flies, at ``at_s`` [s]."""
    flown = (sent_s >= at_s[0]) & (sent_s <= at_s[-1])
    return (float(np.median(shares[flown])) if flown.any() else 0.0) or NOMINAL_HOVER


NOMINAL_HOVER = 0.5
"""Share of full thrust that carries a vehicle of which nobody tells [-]."""


def _configure(
    told: MappedVehicle, hover: float, sent_s: Column, overrides: Sequence[str]
) -> Config:
    """A configuration for a vehicle of others that hovers by the share ``hover`` of full thrust."""
    period_s = float(np.median(np.diff(sent_s))) if len(sent_s) > 1 else 0.01
    vehicle = {
        "name": "recorded",
        "mass_kg": told.mass_kg,
        "thrust_max_n": told.mass_kg * GRAVITY / hover,
        "thrust_min_n": 1e-3 * told.mass_kg,
        "thrust_lag_s": told.thrust_lag_s,
        "thrust_delay_s": told.thrust_delay_s,
        "rate_lag_s": told.rate_lag_s,
        "thrust_curve": told.thrust_curve,
        "frame_period_s": min(max(period_s, 0.001), 0.2),
    }
    return from_dict({"vehicle": vehicle}, Config, overrides)


def _turn_commands(flight: EvidenceFlight, at_s: Column) -> tuple[Column, Column | None, Column]:
    """Times (M,) [s], thrust signals (M,) and body rates (M, 3) of the commands.

    Where no rates were commanded, there is a command at each pose: rates by the attitude that was
    commanded, or as the vehicle turned last. The signals are None where no thrust is known either.
    """
    sent, attitudes = flight.sent, [pose.attitude for pose in flight.poses]
    sent_s = np.array([one.time_s for one in sent])
    signals = np.array([one.thrust for one in sent])
    rates = [(w.x, w.y, w.z) for one in sent if (w := one.rates_rad_s) is not msgspec.UNSET]
    if sent and len(rates) == len(sent):
        return sent_s, signals, np.array(rates)
    newest = np.clip(np.searchsorted(sent_s, at_s, "right") - 1, 0, None).tolist()
    wanted = [(a.w, a.x, a.y, a.z) for one in sent if (a := one.attitude) is not msgspec.UNSET]
    if sent and len(wanted) == len(sent):
        turns = [so3.turn_between(q, wanted[k]) for q, k in zip(attitudes, newest, strict=True)]
        turned = flight.told.attitude_p * np.array(turns)
    else:
        turns = [so3.turn_between(a, b) for a, b in pairwise(attitudes)]
        turned = np.array(turns) / np.diff(at_s)[:, None]
        turned = np.concatenate([turned[:1], turned])
    return at_s, signals[newest] if sent else None, turned


def identify_vehicle(driven: DrivenFlight) -> dict[str, Any]:
    """Identify the vehicle by parameter: value and 95 % interval, or the reason for having none."""
    flight = driven.flight
    sent_s = np.array([time_s for time_s, _ in driven.commands])
    thrust_n = np.array([command.thrust for _, command in driven.commands])
    rates = np.array([command.rates for _, command in driven.commands])
    on = (driven.at_s >= driven.at_s[driven.air.start]) & (
        driven.at_s <= driven.at_s[driven.air.stop - 1]
    )
    poses = np.array(
        [(p.time_s, p.reset_count, 0.0, *p.position_ned, *p.attitude) for p in driven.poses]
    )
    poses[on, 2] = 1.0
    chosen = poses[find_stretch(sent_s, poses)]
    chosen = chosen[: int(np.searchsorted(chosen[:, 0], chosen[:1, 0].sum() + IDENTIFIED_S))]
    try:
        if not len(chosen) or chosen[-1, 0] - chosen[0, 0] < LEAST_S:
            raise StretchTooShort(notice("evidence.unbroken", least_s=LEAST_S))
        parts = (sent_s, thrust_n, rates, chosen[:, 0], chosen[:, 3:6], chosen[:, 6:10])
        found = identify(FlightStretch(flight.path, driven.config, *parts))
    except (StretchTooShort, np.linalg.LinAlgError, ValueError, ZeroDivisionError) as error:
        return {"note": f"not identifiable: {error}"}
    # Otherwise they are ours, made of set-points of the attitude.
    own_rates = flight.sent[0].attitude is msgspec.UNSET
    return {
        one.name: {"value": one.value, "interval": one.interval, "unit": one.unit, "note": one.note}
        for one in found.parameters.values()
        if own_rates or "rate_" not in one.name
    }


class Judged(NamedTuple):
    """Consistency and prediction errors of the filter in one flight."""

    nis3: float | None
    prediction: dict[str, dict[str, float] | None]


def judge_filter(driven: DrivenFlight, gains: Estimation) -> Judged:
    """Fly the filter over the part that flies, and judge its predictions by the measured poses."""
    air, at_s, place = driven.air, driven.at_s, driven.place
    resets = [pose.reset_count for pose in driven.poses]
    period_s = float(np.median(np.diff(at_s[air])))
    base = max(1, round(BASE_S / period_s))
    ahead = {h: max(1, round(1e-3 * h / period_s)) for h in HORIZONS_MS}
    # A flight may have a million poses.
    errors: dict[int, array[float]] = {h: array("d") for h in HORIZONS_MS}
    consistency: list[float] = []
    for i, estimator in _fly_filter(driven, gains, consistency):
        now, older = float(at_s[i]), i - 2 * base
        if older < air.start or now - at_s[older] > LOST_INTERVALS * 2.0 * base * period_s:
            continue
        velocity = (place[i] - place[i - base]) / (now - at_s[i - base])
        before = (place[i - base] - place[older]) / (at_s[i - base] - at_s[older])
        acceleration = (velocity - before) / (0.5 * (now - at_s[older]))
        tangent = velocity + 0.5 * (now - at_s[i - base]) * acceleration
        for h, steps in ahead.items():
            j = i + steps
            if j >= air.stop or len(set(resets[older : j + 1])) > 1:
                continue
            h_s = float(at_s[j]) - now
            if abs(h_s - 1e-3 * h) > NEAR * 1e-3 * h:
                continue
            predicted = np.array(estimator.predict(float(at_s[j])).motion.position)
            predicted -= driven.poses[i].position_ned
            true = place[j] - place[i]
            constant = tangent * h_s + 0.5 * acceleration * h_s**2
            for off in (predicted - true, velocity * h_s - true, constant - true):
                errors[h].append(float(off @ off))
    return Judged(
        float(np.mean(consistency)) / 3.0 if consistency else None,
        {str(h): _measure_errors(np.array(off).reshape(-1, 3)) for h, off in errors.items()},
    )


def _fly_filter(
    driven: DrivenFlight, gains: Estimation, consistency: list[float]
) -> Iterator[tuple[int, ModelEstimator]]:
    """Feed the filter; yield the index of each pose that it has taken, once it has settled.

    It begins anew after a gap. ``consistency`` gets the NIS of each settled pose.
    """
    air, commands, vehicle = driven.air, driven.commands, driven.config.vehicle
    estimator, newest_s, begun_s, k = ModelEstimator(vehicle, gains), -math.inf, -math.inf, 0
    for i in range(air.start, air.stop):
        pose, now = driven.poses[i], float(driven.at_s[i])
        if now - newest_s > POSE_GAP_S:
            estimator, begun_s, k = ModelEstimator(vehicle, gains), now, max(k - 1, 0)
        newest_s = now
        while k < len(commands) and commands[k][0] <= now:
            estimator.add_command(commands[k][0] + vehicle.command_delay_s, commands[k][1])
            k += 1
        settled = now >= begun_s + SETTLING_S
        if settled and pose.reset_count == driven.poses[i - 1].reset_count:
            consistency.append(estimator.consistency(pose))
        estimator.update(pose)
        if settled:
            yield i, estimator


ERRORS = ("rms_mm", "pvt_rms_mm", "ca_rms_mm")
"""Errors of a prediction: ours, with constant velocity, with constant acceleration."""


def _measure_errors(squares: Column) -> dict[str, float] | None:
    """RMS [mm] over all predictions (N, 3) [m²]; None where no pose judges them."""
    if not len(squares):
        return None
    rms_mm = (round(1e3 * math.sqrt(one), 3) for one in squares.mean(axis=0).tolist())
    return dict(zip(ERRORS, rms_mm, strict=True))


TOLD = (
    "pose_noise_m",
    "pose_jitter_s",
    "pose_wander",
    "acceleration_noise",
    "wind_noise",
    "wind_rate_noise",
)
"""Noise keys of ``[controller]`` for the filter."""


def tell_noise(driven: DrivenFlight, noise: PoseNoise) -> list[Estimation]:
    """Configure the filter's noise by that of the source: as configured but for the poses, and
    twice the likeliest.

    Of these the second lets the positions wander: errors of a source may last from pose to pose.
    """
    noise_m = max(noise.across_m, math.sqrt(NOISE_FLOOR_M2))
    told = msgspec.structs.replace(
        driven.config.controller, pose_noise_m=noise_m, pose_jitter_s=noise.jitter_s
    )
    tried = [told]
    at_s, left = driven.at_s[driven.air], driven.place[driven.air] - integrate_thrust(driven)
    for wanders in (False, True):
        wander, acceleration, wind = find_noise(at_s, left, wanders=wanders)
        if driven.flight.sent:  # in still air the filter would take noise for wind
            wind = min(wind, told.wind_noise)
        found = {
            "pose_wander": wander,
            "acceleration_noise": max(acceleration, LEAST_DENSITY),
            "wind_noise": max(wind, LEAST_DENSITY),
            "wind_rate_noise": told.wind_rate_noise
            * min(1.0, max(wind, LEAST_DENSITY) / told.wind_noise),
        }
        tried.append(msgspec.structs.replace(told, **found))
    # As it is printed, so that a configuration with these lines flies the very filter that is
    # judged.
    return [
        msgspec.structs.replace(one, **{key: float(f"{getattr(one, key):.3g}") for key in TOLD})
        for one in tried
    ]


LEAST_DENSITY = 1e-3
"""Density assumed for a noise that does not show [m/s² or m/s³ per √Hz]: the filter's noise is
never nought."""


def integrate_thrust(driven: DrivenFlight) -> Column:
    """Motion of the poses that fly, from rest, under commanded thrust along the measured attitudes
    (N, 3) [m].
    """
    at_s, poses = driven.at_s[driven.air], driven.poses[driven.air]
    sent_s = np.array([time_s for time_s, _ in driven.commands])
    thrust_n = np.array([command.thrust for _, command in driven.commands])
    vehicle = driven.config.vehicle
    acting = respond_with_lag(
        sent_s, thrust_n, vehicle.command_delay_s + vehicle.thrust_delay_s, vehicle.thrust_lag_s
    )
    h = np.diff(at_s)[:, None]
    along = np.array([so3.third_column(pose.attitude) for pose in poses])
    push = (
        -np.diff(acting.integral(at_s))[:, None]
        / h
        / vehicle.mass_kg
        * 0.5
        * (along[1:] + along[:-1])
    )
    push[:, 2] += driven.config.controller.gravity
    speed = np.cumsum(h * push, axis=0) - h * push
    return np.concatenate([np.zeros((1, 3)), np.cumsum(h * speed + 0.5 * h * h * push, axis=0)])


LEANS_S = 0.1
"""Time over which an acceleration must show in the lean [s]."""
LEANS_M_S2 = 0.5
"""Least such acceleration to a side [m/s²]."""
LEANS = (0.2, 5.0)
"""On at least one axis the acceleration is between these shares of what the tilt gives, wind and
drag included [-]."""
AGAINST = -0.4
"""On no axis is that share below this, wind and drag included [-]."""


def doubt_attitude(driven: DrivenFlight) -> str:
    """Why its attitudes can't be those of its positions.

    Empty where they can, or where hardly anything moves.
    """
    at_s, place = driven.at_s[driven.air], driven.place[driven.air]
    k = max(1, round(LEANS_S / float(np.median(np.diff(at_s)))))
    if len(at_s) < 4 * k:
        return ""
    spans = np.stack([at_s[k:-k] - at_s[: -2 * k], at_s[2 * k :] - at_s[k:-k]])[..., None]
    whole = spans.max(axis=0)[:, 0] < LOST_INTERVALS * np.median(spans)
    shares = []
    went, leant = (
        (
            2.0
            * ((of[2 * k :] - of[k:-k]) / spans[1] - (of[k:-k] - of[: -2 * k]) / spans[0])
            / spans.sum(axis=0)
        )[whole]
        for of in (place, integrate_thrust(driven))
    )
    for seen, given in zip(
        (went - went.mean(axis=0)).T[:2], (leant - leant.mean(axis=0)).T[:2], strict=True
    ):
        if float(seen.std()) > LEANS_M_S2:
            shares.append(float((seen @ given) / max(given @ given, 1e-12 * (seen @ seen))))
    if not shares or (
        any(LEANS[0] < share < LEANS[1] for share in shares) and min(shares) > AGAINST
    ):
        return ""
    return notice("evidence.leans", shares=" and ".join(f"{share:.2g}" for share in shares)).text


def examine_flight(
    path: Path, config: Config | None = None, overrides: Sequence[str] = ()
) -> dict[str, Any]:
    """All that one recorded flight tells, as ``--json`` prints it.

    Raises:
        ConfigError: see :func:`load_flight`.
    """
    driven = drive_flight(load_flight(path, config), overrides)
    flight, air = driven.flight, driven.air
    at_s, place = driven.at_s[air], driven.place[air]
    spans = np.diff(at_s)
    whole = spans[spans <= POSE_GAP_S] if (spans <= POSE_GAP_S).any() else spans
    noise = measure_pose_noise(at_s, place)
    facts: dict[str, Any] = {
        "name": path.stem,
        "source": flight.source,
        "poses": len(flight.poses),
        "flown_s": round(float(whole.sum()), 2),
        "pose_hz": round(len(whole) / float(whole.sum()), 2),
        "gap_max_ms": round(1e3 * float(spans.max()), 2),
        "jitter_ms": round(1e3 * noise.jitter_s, 3),
        "noise_across_mm": round(1e3 * noise.across_m, 4),
        "noise_along_mm": round(1e3 * noise.along_m, 4),
        "velocity_off_m_s": _measure_velocity(flight.poses[air], at_s, place),
        "left_out": flight.left_out,
        "trouble": flight.trouble,
        "note": why_not_judged(flight, at_s, place) if not flight.own else "",
        "doubt": "",
        "told": {},
        "nis3": None,
        "prediction": {},
        "untold": Judged(None, {})._asdict(),
        "identified": {},
    }
    if facts["note"]:
        return facts
    tried = [(gains, judge_filter(driven, gains)) for gains in tell_noise(driven, noise)]
    # Of these the filter that is as sure as it is good.
    gains, judged = min(
        tried, key=lambda one: abs(math.log(max(one[1].nis3 or 1.0, LEAST_DENSITY)))
    )
    facts |= {"doubt": doubt_attitude(driven), "told": {key: getattr(gains, key) for key in TOLD}}
    facts |= judged._asdict()
    facts["untold"] = judge_filter(driven, driven.config.controller)._asdict()
    if flight.sent:
        facts["identified"] = identify_vehicle(driven)
    return facts


def _measure_velocity(poses: Sequence[Pose], at_s: Column, place: Column) -> float | None:
    """RMS of the source's own velocity less that of its positions [m/s].

    None where it tells none.
    """
    if any(pose.velocity_ned is None for pose in poses):
        return None
    off = np.array([pose.velocity_ned for pose in poses]) - np.gradient(place, at_s, axis=0)
    return round(math.sqrt(float((off**2).sum(axis=1).mean())), 4)


def evidence_command(
    paths: Sequence[Path],
    config: Config | None = None,
    overrides: Sequence[str] = (),
    *,
    as_json: bool,
) -> Exit:
    """Print what the recordings at ``paths`` tell; returns 0.

    ``config`` describes a vehicle of others, else the recording itself with ``overrides``.

    Raises:
        ConfigError: one of them is no recording of a flight.
    """
    flights = [examine_flight(path, config, overrides) for path in paths]
    print(
        json.dumps({"flights": flights}) if as_json else "\n\n".join(map(describe_flight, flights))
    )
    return Exit.DONE


def describe_flight(facts: dict[str, Any]) -> str:
    """Describe the figures as lines."""
    lines = [
        f"{facts['name']} ({facts['source']}): {facts['flown_s']:.1f} s in the air, "
        f"{facts['pose_hz']:.1f} poses/s, longest gap {facts['gap_max_ms']:.0f} ms",
        f"  noise {facts['noise_across_mm']:.3f} mm across the motion, "
        f"{facts['noise_along_mm']:.3f} mm along it; stamps off by {facts['jitter_ms']:.2f} ms; "
        f"NIS/3 {_text(facts['nis3'])}",
    ]
    if facts["trouble"]:
        lines.append(f"  the recording {facts['trouble']}. This is from what is in it before.")
    if facts["velocity_off_m_s"] is not None:
        lines.append(
            f"  its own velocity is {facts['velocity_off_m_s']:.3f} m/s RMS from that of its "
            "positions"
        )
    lines += [f"  {facts[key]}" for key in ("note", "doubt") if facts[key]]
    if not facts["note"]:
        lines.append(f"  {'prediction, RMS mm':22}{'ours':>9}{'p + v t':>9}{'const. a':>9}")
        rows = {f"{horizon} ms": row for horizon, row in facts["prediction"].items()}
        rows |= {
            f"{horizon} ms, told nothing": row
            for horizon, row in facts["untold"]["prediction"].items()
        }
        for name, row in rows.items():
            cells = (
                "".join(f"{row[key]:>9.2f}" for key in ERRORS) if row else "  no pose to judge by"
            )
            lines.append(f"  {name:22}{cells}")
        told = ", ".join(f"{key} = {value:g}" for key, value in facts["told"].items())
        lines.append(
            f"  NIS/3 {_text(facts['untold']['nis3'])}, told nothing; told in [controller]: {told}"
        )
    for name, one in facts["identified"].items():
        if name == "note":
            lines.append(f"  {one}")
        elif one["value"] is not None:
            low, high = one["interval"]
            lines.append(
                f"  {name:22}{one['value']:.3g} ({low:.3g} to {high:.3g}) {one['unit']}".rstrip()
            )
    lines += [
        f"  not used as it stands, {reason}: {count}" for reason, count in facts["left_out"].items()
    ]
    return "\n".join(lines)


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
