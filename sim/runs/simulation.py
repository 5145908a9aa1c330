"""Simulation for programs and notebooks: fly one scenario, and read its recording as arrays.

A flight's folder holds the configuration, the recording (flight.mcap, flight.tlog), and the result.
"""

import asyncio
import concurrent.futures as cf  # noqa: TID251  # beside an event loop that runs already, as in a notebook, and only there
import contextvars
import json
import sys
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec

from groundstation.analysis import FlightData
from groundstation.config import (
    ConfigError,
    dump,
    lend,
    name_object,
    refuse_io,
    several,
    without_frames,
)
from groundstation.core.messages import EndRecord, Sentence, TickRecord
from groundstation.core.trajectory import FeasibilityReport
from groundstation.flight import about
from groundstation.flight.preflight import ensure_flyable
from groundstation.machine import write_whole
from groundstation.recording import FlightLog, LineRecord, Record
from groundstation.runtime import DAY_S
from groundstation.settings import Config
from sim.runs.flight import Result, fly
from sim.scenarios import BETAFLIGHT, Scenario, choose_scenario, prepare, prepare_own
from sim.text import notice
from sim.world import World

DURATION_S = 60.0
"""Default duration of a flight [s]: what the figures of the scenarios are defined for."""
T = TypeVar("T")


class Run(FlightData):
    """A simulated flight: its result (``completed``, ``why``, ``facts``), and all data of its
    recording.
    """

    def __init__(
        self, path: Path | None, facts: dict[str, Any], result: Result, *, is_whole: bool = True
    ) -> None:
        """``path`` is the recording; None without one."""
        self.is_whole = is_whole
        """Whether the recording has all of the flight: not where the disk was full."""
        self.facts = facts
        """Figures that ``groundstation-sim fly --json`` prints."""
        self.result = result
        """The result, with the errors against the truth."""
        if path is not None:
            self.path = path  # FlightData reads it at the first access

    def __getattr__(self, name: str) -> Any:
        if "path" in self.__dict__:
            raise AttributeError(f"a run has nothing of the name {name!r}")
        raise AttributeError(str(notice("sim.unknown", name=name)))

    def __repr__(self) -> str:
        """Scenario, controller, seed and error, for a notebook."""
        rms = self.facts["rms_cm"]
        error = f"RMS error {rms:.2f} cm" if rms is not None else "no steady part"
        went = (
            f"{error} in {self.facts['duration_s']:g} s"
            if self.completed
            else f"not completed: {self.why}"
        )
        return (
            f"<Run of {self.facts['scenario']}, {self.facts['controller']}, seed "
            f"{self.facts['seed']}: {went}>"
        )

    @property
    def completed(self) -> bool:
        """Whether the flight reached its end without a crash or an abort."""
        return self.result.completed

    @property
    def why(self) -> str:
        """Reason of its end, as a sentence."""
        return self.result.why

    @property
    def error_against(self) -> str:
        """``truth``: a simulation knows it."""
        return "truth"

    @property
    def rms_cm(self) -> float | None:
        """Root mean square of the true error over the steady part [cm].

        None if the flight ended before it.
        """
        return self.result.verdict.rms_cm

    @property
    def max_cm(self) -> float | None:
        """Largest true error of the steady part [cm]; None if the flight ended before it."""
        return self.result.verdict.max_cm


@without_frames
def simulate(
    scenario: str = "paper",
    *,
    controller: object = None,
    trajectory: object = None,
    duration: float | None = None,
    seed: int = 0,
    overrides: str | Sequence[str] = (),
    config: Path | str | None = None,
    source: str = "vicon",
    link: str | None = None,
    autopilot: str = "px4",
    out: Path | str | None = None,
    record: bool = True,
    on_progress: Callable[[float, float], None] | None = None,
) -> Run:
    """Fly one scenario in virtual time, on the real wire bytes: what ``groundstation-sim fly``
    does.

    Args:
        scenario: one of ``groundstation-sim scenarios``.
        controller: the name of a built-in one (``"adaptive"``, ``"pid"``, ...), or your own, in one
            of these forms: a class or another factory, called with as much of the vehicle and the
            options as it needs, whose result has ``decide(estimate, reference, interval_s)``; the
            function ``decide`` itself; an object with ``decide``, of which each flight gets a copy;
            ``"package.module:factory"``. Without it, the adaptive one.
        trajectory: the name of a built-in one, or your own, in one of these forms: a class or
            another factory, called with the options if it takes any (not with the vehicle), whose
            result has ``at(time_s)``, which returns a Reference; the function ``at`` itself;
            ``"package.module:factory"``. Without it, the scenario's.
        duration: duration of the flight [s]; without it 60, or that of ``config``.
        seed: seed of every random draw.
        overrides: ``"key=value"`` each, as ``--set``: ``sim.KEY`` changes the simulated world, any
            other key the configuration of the ground station.
        config: a configuration file, whose vehicle and trajectory are flown in the scenario's air.
        source: pose source: vicon, natnet, qualisys, odometry, vision, json.
        link: command link: mavlink, dsm, crsf, rf_bridge; without it mavlink, and crsf to
            Betaflight.
        autopilot: simulated autopilot: px4, ardupilot; or betaflight, whose own firmware flies.
        out: folder for the recording and the other files of the flight; without it a temporary one.
        record: False leaves the recording out: then only ``facts`` and ``result`` are known.
        on_progress: called once per second of flight with the flown and the whole duration [s].

    Raises:
        ConfigError: an unknown name or key, a bad value, or a flight that the vehicle can't fly.
        UserCodeFault: a controller or trajectory of your own failed in flight; its cause shows
            where.
    """
    if out is not None and not record:
        raise ConfigError("--out", notice("sim.not_recorded"))
    settings, own = [str(one) for one in several(overrides)], dict[str, object]()
    kind = lend_name(controller, own)
    if trajectory is not None:
        settings.append(f"trajectory.kind={lend_name(trajectory, own)}")
    chosen, link = choose_scenario(scenario, autopilot, link, source)
    seed = check_whole("--seed", seed, 0)
    duration = None if duration is None else check_duration(duration)
    ends = Ends(source, autopilot, link)
    with lend(own):
        plan = _plan(
            chosen, settings, kind, ends, seed, duration, None if config is None else Path(config)
        )
        path = Path(_make_temporary() if record and out is None else out or ".")
        folder = (
            RunFolder(path, plan.config, plan.world, scenario=plan.name, seed=seed)
            if record
            else None
        )
        with _keep_on_error(folder):
            result = run_beside(partial(_fly, plan, folder, on_progress))
            facts = _state_facts(plan, result)
    if folder is not None:
        folder.close(facts)
    is_whole = folder is None or folder.is_whole
    run = Run(path / RECORDING if record else None, facts, result, is_whole=is_whole)
    if out is None and record:
        weakref.finalize(run, _remove, path)
    return run


class Ends(NamedTuple):
    """Both ends of the ground station in the simulation: pose source, autopilot and link, as in
    :func:`simulate`.
    """

    source: str
    autopilot: str
    link: str


class Plan(NamedTuple):
    """A flight that has passed the checks."""

    name: str
    """Name of the scenario in the recording."""
    world: World
    config: Config
    ends: Ends
    seed: int
    duration_s: float
    demands: FeasibilityReport
    """Demands of the trajectory on the vehicle."""


def check_duration(duration_s: object, above_s: float = 0.0) -> float:
    """Check the option ``--duration`` [s], and make a plain number of it: JSON takes no NumPy
    numbers.

    Raises:
        ConfigError: it is no number above ``above_s``, or more than a day.
    """
    if not (isinstance(duration_s, Real) and above_s < float(duration_s) <= DAY_S):
        id = "value.seconds" if above_s == 0.0 else "sim.judged_seconds"
        raise ConfigError("--duration", notice(id, above=above_s, most=DAY_S, found=duration_s))
    return float(duration_s)


def check_whole(option: str, number: object, least: int) -> int:
    """Check the whole number of an ``option``, and make a plain number of it.

    Raises:
        ConfigError: it is no whole number of at least ``least``.
    """
    if not (isinstance(number, Integral) and int(number) >= least):
        raise ConfigError(option, notice("value.whole_number", least=least, found=number))
    return int(number)


def _plan(
    scenario: Scenario,
    overrides: list[str],
    controller: str | None,
    ends: Ends,
    seed: int,
    duration: float | None,
    file: Path | None,
) -> Plan:
    """Prepare the scenario, or a vehicle of the user's own ``file`` in its air."""
    wanted_s, name = None, scenario.name
    if file is None:
        world, config = prepare(
            scenario, overrides, controller=controller, source=ends.source, link=ends.link
        )
    else:
        _require_own_ends(ends)
        world, config, wanted_s = prepare_own(scenario, file, overrides, controller=controller)
        name = f"{file.stem} in the air of {scenario.name}"
    return Plan(
        name, world, config, ends, seed, duration or wanted_s or DURATION_S, ensure_flyable(config)
    )


def _require_own_ends(ends: Ends) -> None:
    """Refuse autopilots, sources and links with which a user's own configuration can't be
    simulated.
    """
    if ends.autopilot == BETAFLIGHT:
        raise ConfigError("--config", notice("sim.one_betaflight"))
    if ends.source != "vicon":
        raise ConfigError("--source", notice("sim.own_source"))
    if ends.link != "mavlink":
        raise ConfigError("--link", notice("sim.own_link"))


def _fly(
    plan: Plan, folder: "RunFolder | None", on_progress: Callable[[float, float], None] | None
) -> Result:
    """Fly ``plan`` and record it in ``folder``.

    ``on_progress`` gets the flown and the whole duration [s].
    """
    if on_progress is not None:
        on_progress(0.0, plan.duration_s)
    return fly(
        plan.world,
        plan.config,
        seed=plan.seed,
        duration_s=plan.duration_s,
        autopilot=plan.ends.autopilot,
        give=folder.give if folder is not None else None,
        on_progress=None
        if on_progress is None
        else lambda done_s: on_progress(done_s, plan.duration_s),
    )


def _state_facts(plan: Plan, result: Result) -> dict[str, Any]:
    """Return the figures of the flight that ``groundstation-sim fly --json`` prints."""
    return {
        "scenario": plan.name,
        "seed": plan.seed,
        "controller": plan.config.controller.kind,
        **plan.ends._asdict(),
        "completed": result.completed,
        "why": result.why,
        "duration_s": result.duration_s,
        **msgspec.to_builtins(result.verdict),
        "thrust_bound_m_s2": _thrust_bound(
            plan.config, plan.demands, result.verdict.lyapunov_start
        ),
        "log_sha256": result.log_sha256,
        "warnings": list(result.warnings),
        "datagrams": result.datagrams,
        "wall_s": result.wall_s,
    }


def _make_temporary() -> str:
    """Make a folder that is removed when the program ends, if not before."""
    import atexit
    import tempfile

    folder = tempfile.mkdtemp(prefix="groundstation-")
    atexit.register(_remove, folder)
    return folder


def _remove(folder: Path | str) -> None:
    import shutil

    shutil.rmtree(folder, ignore_errors=True)


def lend_name(thing: object, own: dict[str, object]) -> str | None:
    """Return the name by which a configuration refers to ``thing``.

    An object is added to ``own`` under that name.
    """
    if thing is None or isinstance(thing, str):
        return thing
    name, number = name_object(thing), 1
    while own.get(name, thing) is not thing:
        number += 1
        name = f"{name_object(thing)}_{number}"
    own[name] = thing
    return name


def run_beside(work: Callable[[], T]) -> T:
    """Return the result of ``work``, which runs an event loop: in another thread if one runs here
    already.
    """
    if asyncio._get_running_loop() is None:  # get_running_loop() would raise
        return work()
    with cf.ThreadPoolExecutor(1) as thread:
        return thread.submit(contextvars.copy_context().run, work).result()


@contextmanager
def _keep_on_error(folder: "RunFolder | None") -> Iterator[None]:
    """Keep the recording of a flight that ends in an error."""
    try:
        yield
    except BaseException:
        if folder is not None:
            folder.abandon()
        raise


def _thrust_bound(
    config: Config, demands: FeasibilityReport, v_start: float | None
) -> float | None:
    """Return the a-priori bound on T/m for this flight [m/s²] (docs/explanation/law.md, section 4);
    None without that law.
    """
    from groundstation.core.control import Law, thrust_bound

    if v_start is None or not isinstance(config.controller, Law):
        return None
    return thrust_bound(
        config.controller, acceleration_sup=demands.acceleration_m_s2, v_start=v_start
    )


RECORDING = "flight.mcap"
"""Name of the recording in a run's folder."""


class RunFolder:
    """The folder of one run, and the files that are being written to it."""

    def __init__(
        self, path: Path, config: Config, world: World, *, scenario: str, seed: int
    ) -> None:
        """Make the folder and begin the recording; that of a former run is replaced.

        Raises:
            ConfigError: the folder can't be written.
        """
        self.path = path
        header = about(config, clock="virtual", scenario=scenario, seed=seed, sim=dump(world))
        with refuse_io("--out", "file.unwritten", path):
            path.mkdir(parents=True, exist_ok=True)
            write_whole(path / "config.toml", header.config)
            for name in (RECORDING, "flight.tlog"):
                (path / name).unlink(missing_ok=True)
            # Times of the recording begin at 0, not at the wall clock: the same flight gives the
            # same bytes.
            self._log = FlightLog(path / RECORDING, header, epoch_ns=0, tell=self._warn)
        self.is_whole = True
        """Whether all that was given is written so far."""
        self._world = world
        self._last_s = 0.0
        self._state = "idle"
        self._ended = False

    def give(self, record: Record) -> None:
        """Take one record of the flight."""
        self._log.write(record)
        if type(record) is TickRecord:
            self._last_s = record.tick.time_s
        elif type(record) is LineRecord:
            self._state = record.state
        elif type(record) is EndRecord:
            self._ended = True

    def abandon(self) -> None:
        """Keep all records of a simulation that ends in an error: the last ones show its cause."""
        self._log.flush()
        self._log.leave()

    def close(self, facts: dict[str, Any]) -> None:
        """Write the result and close everything."""
        if not self._ended:  # the simulation ended in the air, so the mission wrote no end
            self._log.write(EndRecord(self._last_s, self._state, facts["why"]))
        rms_cm, max_cm = facts.get("rms_cm"), facts.get("max_cm")
        self._log.close(*(None if value is None else 0.01 * value for value in (rms_cm, max_cm)))
        result = {**facts, "sim": msgspec.to_builtins(self._world)}
        summary = self.path / "summary.json"
        try:
            write_whole(summary, json.dumps(result, indent=2) + "\n")
        except OSError as error:
            self._warn(notice("recording.no_file", path=summary, why=error.strerror))

    def _warn(self, sentence: Sentence) -> None:
        self.is_whole = False
        print(sentence, file=sys.stderr)
