"""Doctor: an autopilot's parameters, or a Betaflight's settings, looked at, and on request set one
by one, or put back.

The old value is on disk before a new one is set: so every change can be taken back.
"""

import asyncio
import json
import os
import shlex
import shutil
import sys
import textwrap
from collections.abc import Awaitable, Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from groundstation.config import ConfigError, parse_number, refuse_io, refuse_value
from groundstation.core.messages import notice
from groundstation.lab.doctor_advice import (
    FLIGHT_CHANNELS,
    RATE_MOST_DEG_S,
    RATE_UNIT_DEG_S,
    Advice,
    ParameterFinding,
    ReceiverFacts,
    Setting,
    Value,
    VehicleFacts,
    Weight,
    ardupilot_advice,
    betaflight_advice,
    is_wrong,
    judge,
    px4_advice,
    show,
)
from groundstation.machine import open_private
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.core import LinkError, LinkLost, LinkRejected, signal
from links.mavlink import MavlinkConnection, MavlinkLinkConfig
from links.mavlink.protocol import (
    ARDUPILOT,
    ARMED,
    PX4,
    AutopilotParameter,
    Handshake,
    ReadParameters,
    WriteParameter,
    is_same_float32,
)
from links.rf import Board, RfLinkConfig, describe_change, describe_pulses, find_settings


class Restore(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One parameter as it was."""

    vehicle: str
    """The vehicle's name in its configuration."""
    autopilot: str
    """PX4, ArduPilot or Betaflight."""
    system: int | str
    """Its MAVLink system, or the number of a Betaflight's processor."""
    name: str
    value: Value
    kind: int
    """MAV_PARAM_TYPE; 0 on a Betaflight."""

    @property
    def parameter(self) -> Setting:
        """The setting to write."""
        return Setting(self.name, self.value, self.kind)


def save_restore(restore: Restore, folder: Path) -> Path:
    """Write ``restore`` into a new file in ``folder``, for its owner alone, and return its path.

    No file is ever overwritten.

    Raises:
        OSError: it can't be written.
    """
    number = 1
    while True:
        suffix = "" if number == 1 else f"-{number}"
        path = folder / f"restore-{restore.vehicle}-{restore.name.replace(' ', '_')}{suffix}.json"
        try:
            with open(path, "xb", opener=open_private) as file:
                file.write(msgspec.json.encode(restore) + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except FileExistsError:
            number += 1
        else:
            return path


def load_restore(path: Path) -> Restore:
    """The parameter in the file at ``path``.

    Raises:
        ConfigError: it can't be read or holds something else.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Restore)
    except OSError as error:
        raise ConfigError(
            "--restore", notice("file.unread", path=path, why=error.strerror)
        ) from None
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise ConfigError("--restore", notice("doctor.other_file", path=path, why=error)) from None


TABLES: dict[int, Callable[[VehicleFacts], list[Advice]]] = {
    PX4: px4_advice,
    ARDUPILOT: ardupilot_advice,
}
"""HEARTBEAT.autopilot → its advice."""


class BoardVisit:
    """A Betaflight behind a receiver, by its own port: ``open`` it, ``examine``, perhaps ``set``,
    and ``close`` it.
    """

    autopilot = "Betaflight"

    def __init__(self, config: Config, port: str | None) -> None:
        """Nothing is opened yet; ``port`` is the flight controller's own.

        Raises:
            ConfigError: it is none, or the link's map is none that a Betaflight could be set up
                for.
        """
        link = config.link
        if not isinstance(link, RfLinkConfig):
            raise ConfigError("link.kind", notice("doctor.link_kind"))
        if port is None:
            raise ConfigError("--board", notice("doctor.board_missing"))
        with refuse_value("--board"):
            self.facts = _describe_receiver(link, own_curve=config.thrust_curve > 0.0)
            self._board = Board(port)
        self.parameters: dict[str, Setting] = {}

    @property
    def system(self) -> str:
        """The number of its processor."""
        return self._board.uid

    @property
    def advice(self) -> list[Advice]:
        """Return the advice for the settings and mode rows that were read."""
        return betaflight_advice(
            self.facts, {name: one.value for name, one in self.parameters.items()}
        )

    async def open(self) -> None:
        """Connect, and hear that it is not armed."""
        await self._board.open()
        await self._board.ensure_disarmed()

    async def close(self) -> None:
        """Leave its command line: it restarts."""
        await self._board.close()

    async def examine(self) -> list[ParameterFinding]:
        """Read all tables and what the advice names, on its command line."""
        await self._board.enter()
        self.parameters = {}
        for table in ("aux", "rxrange", "rxfail", "map"):
            self.parameters |= self._find_settings(await self._board.tell(table))
        self.parameters |= await self.read(
            name
            for advice in self.advice
            for name in advice.names
            if name not in self.parameters and " " not in name
        )
        return [judge(advice, self.parameters) for advice in self.advice]

    async def read(self, names: Iterable[str]) -> dict[str, Setting]:
        """Those of the settings ``names`` that it has."""
        await self._board.enter()
        found: dict[str, Setting] = {}
        for name in names:
            table = name.split()[0]
            try:
                said = await self._board.tell(
                    table if " " in name or name == "map" else f"get {name}"
                )
            except LinkRejected:
                continue  # another version's
            found |= {
                known: one for known, one in self._find_settings(said).items() if known == name
            }
        return found

    async def set(self, parameter: Setting) -> Setting:
        """Set one, save it, restart, and read it back."""
        await self._board.enter()
        await self._board.tell(describe_change(parameter.name, parameter.value))
        await self._board.save()
        found = await self.read([parameter.name])
        if parameter.name not in found or found[parameter.name].value != parameter.value:
            now = show(found[parameter.name].value) if parameter.name in found else "nothing"
            raise LinkRejected(
                notice(
                    "doctor.reads_back", name=parameter.name, value=show(parameter.value), found=now
                )
            )
        self.parameters |= found
        return found[parameter.name]

    @staticmethod
    def _find_settings(answer: str) -> dict[str, Setting]:
        return {name: Setting(name, value) for name, value in find_settings(answer).items()}


def _describe_receiver(link: RfLinkConfig, *, own_curve: bool) -> ReceiverFacts:
    """Describe the signals that a Betaflight behind the receiver of ``link`` gets."""
    half_us, order = describe_pulses(link)
    sticks = {"roll": link.map.roll, "pitch": link.map.pitch, "yaw": link.map.yaw}
    for axis, stick in sticks.items():
        rate = stick.full_rate_deg_s
        if rate % RATE_UNIT_DEG_S or rate > RATE_MOST_DEG_S:
            raise ValueError(notice("doctor.full_rate", axis=axis, rate_deg_s=rate))
    arm = link.map.arm
    if arm is None or arm.channel <= FLIGHT_CHANNELS:
        raise ValueError(notice("doctor.arm_channel"))
    aux = range(FLIGHT_CHANNELS + 1, link.codec().channels + 1)
    meets = dict.fromkeys(aux, (1500.0, 1500.0))
    for fixed in link.map.fixed:
        meets[fixed.channel] = (1500.0 + half_us * fixed.position,) * 2
    for moved in (link.map.thrust, *sticks.values(), link.map.throttle_copy, arm):
        if moved is not None:
            meets[moved.channel] = (1500.0 - half_us, 1500.0 + half_us)
    armed_us, disarmed_us = (1500.0 + half_us * position for position in (arm.armed, arm.disarmed))
    low_us, high_us = sorted((armed_us, disarmed_us))
    if not (low_us < 1300.0 and high_us >= 1700.0):
        raise ValueError(notice("keys.arm"))
    meets[arm.channel] = (low_us, high_us)
    return ReceiverFacts(
        order=order,
        half_us=half_us,
        rates_deg_s=(
            sticks["roll"].full_rate_deg_s,
            sticks["pitch"].full_rate_deg_s,
            sticks["yaw"].full_rate_deg_s,
        ),
        throttle_low=link.map.thrust.low,
        own_curve=own_curve,
        arm=(arm.channel - aux.start, armed_us, disarmed_us),
        aux_us=tuple(meets[channel] for channel in aux),
    )


class MavlinkVisit:
    """Visit to PX4 and ArduPilot by MAVLink."""

    def __init__(self, config: Config) -> None:
        link = config.link
        assert isinstance(link, MavlinkLinkConfig), "the caller has looked"
        share = config.vehicle.mass_kg * config.controller.gravity / config.full_thrust_n
        self.facts = VehicleFacts(
            own_system=link.system_id,
            target_system=link.target_system,
            hover=signal(share, config.thrust_curve),
            own_curve=config.thrust_curve > 0.0,
            forwards=config.forwards is not None,
            pose_latency_s=getattr(config.pose, "latency_s", None),
        )
        self.parameters: dict[str, Setting] = {}
        self._heartbeat_timeout_s = link.heartbeat_timeout_s
        self._connection = MavlinkConnection(msgspec.structs.replace(link, quiet=False))

    async def open(self) -> None:
        """Connect.

        Raises:
            LinkError: nobody is there, or it is neither PX4 nor ArduPilot.
        """
        await self._connection.open()
        autopilot = self._connection.autopilot()
        if autopilot.kind not in TABLES:
            raise LinkRejected(notice("doctor.unknown_autopilot", kind=autopilot.kind_name))

    async def close(self) -> None:
        """Disconnect."""
        self._connection.close()

    @property
    def system(self) -> int:
        """Its MAVLink system."""
        return self.facts.target_system

    @property
    def autopilot(self) -> str:
        """PX4 or ArduPilot."""
        return self._connection.autopilot().name

    @property
    def advice(self) -> list[Advice]:
        """Return the advice for this kind of autopilot."""
        return TABLES[self._connection.autopilot().kind](self.facts)

    async def examine(self) -> list[ParameterFinding]:
        """Read everything that the table asks about, and judge it.

        Raises:
            LinkError: the autopilot went away, or two of them answer.
        """
        table = self.advice
        self.parameters |= await self.read(name for advice in table for name in advice.names)
        self._refuse_two()
        if not self.parameters:
            raise LinkLost(notice("doctor.no_parameters"))
        return [judge(advice, self.parameters) for advice in table]

    async def read(self, names: Iterable[str]) -> dict[str, Setting]:
        """Those of the parameters ``names`` that it has; raises LinkError."""
        reads = ReadParameters(self._connection.autopilot(), names)
        await self._connection.run_handshake(Handshake([reads]))
        return {name: Setting(*found) for name, found in reads.found.items()}

    async def set(self, parameter: Setting) -> Setting:
        """Set one parameter, read it back, and return it.

        Raises:
            LinkRejected: the vehicle is armed, two answer, or the autopilot keeps another value.
            LinkLost: it does not answer.
            ValueError: such a parameter can't have this value.
        """
        autopilot, value = self._connection.autopilot(), float(parameter.value)
        write = WriteParameter(autopilot, AutopilotParameter(parameter.name, value, parameter.kind))
        if await self._is_armed():
            raise LinkRejected(notice("doctor.armed"))
        self._refuse_two()
        await self._connection.run_handshake(Handshake([write]))
        found = await self.read([parameter.name])
        if parameter.name not in found:
            raise LinkLost(notice("doctor.not_read_back", name=parameter.name))
        now = found[parameter.name]
        if not (isinstance(now.value, float) and is_same_float32(now.value, value)):
            raise LinkRejected(
                notice(
                    "doctor.reads_back",
                    name=parameter.name,
                    value=show(value),
                    found=show(now.value),
                )
            )
        self.parameters[now.name] = now
        return now

    def _refuse_two(self) -> None:
        """Stop where a second autopilot would obey too, or instead; raises LinkRejected."""
        if conflict := self._connection.conflict:
            raise LinkRejected(conflict)

    async def _is_armed(self) -> bool:
        """Return the arming state from the next heartbeat; the one before may be old."""
        beat: asyncio.Future[bool] = asyncio.get_running_loop().create_future()

        def hear(message: Any, _: float) -> None:
            if message.get_type() == "HEARTBEAT" and not beat.done():
                beat.set_result(bool(message.base_mode & ARMED))

        leave = self._connection.subscribe(hear)
        try:
            async with asyncio.timeout(self._heartbeat_timeout_s):
                return await beat
        except TimeoutError:
            raise LinkLost(
                notice("doctor.no_heartbeat", limit_s=self._heartbeat_timeout_s)
            ) from None
        finally:
            leave()


Visit = BoardVisit | MavlinkVisit
"""Changes nothing by itself. All methods but ``close`` raise LinkError if the other end leaves."""
_MARKS = {"ok": "ok", "must": "MUST", "should": "SHOULD", "note": "note", "absent": "-"}


def doctor_report(title: str, findings: Sequence[ParameterFinding], command: str) -> str:
    """The table, the worst first, each that is not right with its reason and the ``command`` that
    mends it.
    """
    worst_first = ("must", "should", "ok", "note", "absent")
    wide = max(17, *(len(finding.name) + 1 for finding in findings))
    lines = [title, "", f"{'':8}{'parameter':{wide}}{'value':>9}  accepted"]
    for finding in sorted(findings, key=lambda f: worst_first.index(f.verdict)):
        value = "-" if finding.value is None else show(finding.value)
        lines += _wrap(
            f"{_MARKS[finding.verdict]:8}{finding.name:{wide}}{value:>9}  ", finding.accepted
        )
        if finding.verdict in (Weight.MUST, Weight.SHOULD, Weight.NOTE):
            lines += _wrap(" " * 12, finding.why)
        if finding.recommended is not None:
            value = show(finding.recommended)
            mend = notice(
                "doctor.set_to", value=value, command=command, name=shlex.quote(finding.name)
            )
            lines.append(f"{'':12}{mend}")
            if finding.reboot:
                lines.append(f"{'':12}{notice('doctor.reboot')}")
    lines += ["", _summary(findings)]
    return "\n".join(lines)


def _wrap(begin: str, text: str) -> list[str]:
    width, indent = shutil.get_terminal_size().columns, " " * max(len(begin), 12)
    return textwrap.wrap(text, width, initial_indent=begin, subsequent_indent=indent)


def _summary(findings: Sequence[ParameterFinding]) -> str:
    counts = {verdict: sum(f.verdict == verdict for f in findings) for verdict in _MARKS}
    absent = f", {counts['absent']} not in this firmware" if counts["absent"] else ""
    row = "doctor.changes" if is_wrong(findings) else "doctor.healthy"
    return notice(row, **counts | {"absent": absent}).text


Ask = Callable[[str], Awaitable[str]]


class DoctorOrders(NamedTuple):
    """Options of the operator."""

    command: str
    """The command as it was called, to be shown with ``--fix``."""
    fix: tuple[str, ...] = ()
    """Each ``NAME`` or ``NAME=VALUE``."""
    restore: Path | None = None
    """File of an earlier fix."""
    yes: bool = False
    """Do not ask."""
    as_json: bool = False
    folder: Path = Path()
    """Where old values are kept."""
    board: str | None = None
    """The own port of a flight controller behind a receiver."""


class _Fix(NamedTuple):
    """One change, and where the old value is kept."""

    name: str
    old: Value
    new: Value
    saved: str


async def run_doctor(
    config: Config, orders: DoctorOrders, ask: Ask | None, say: Callable[[str], None] = print
) -> Exit:
    """Visit the autopilot of ``config``.

    ``ask`` puts a question to the operator, None where nobody is there.

    ``say`` tells what was found.

    Returns 0 where all is as it should be, 1 where something is not or was not confirmed, 3 where
    the autopilot does not answer or refuses.

    Raises:
        ConfigError: the orders make no sense.
    """
    _check_orders(orders, ask)
    kept = load_restore(orders.restore) if orders.restore is not None else None
    visit = _choose_visit(config, orders)
    try:
        await visit.open()
        findings = await visit.examine()
        all_wanted = (
            [_parse_fix(fix, visit) for fix in orders.fix]
            if kept is None
            else [await _find_old(visit, kept)]
        )
        _ensure_each_once(all_wanted)
        fixed: list[_Fix] = []
        for wanted in all_wanted:
            one = await _set(visit, wanted, config, orders, ask)
            if one is None:
                break
            fixed.append(one)
            if not orders.as_json:
                say(_describe_undo(one, orders))
        confirmed = len(fixed) == len(all_wanted)
        if all_wanted and not fixed:
            return Exit.FAILED
        if fixed:
            findings = await visit.examine()
        say(_format_result(visit, findings, fixed, config, orders))
    except LinkError as error:
        print(f"groundstation: doctor: {error}", file=sys.stderr)
        return Exit.UNHEARD
    finally:
        await visit.close()
    return Exit.FAILED if is_wrong(findings) or not confirmed else Exit.DONE


def _check_orders(orders: DoctorOrders, ask: Ask | None) -> None:
    """Refuse options that contradict each other, and changes that nobody could confirm."""
    if orders.yes and not orders.fix and orders.restore is None:
        raise ConfigError("--yes", notice("doctor.yes_alone"))
    if orders.fix and orders.restore is not None:
        raise ConfigError("--restore", notice("doctor.restore_alone"))
    if (orders.fix or orders.restore) and ask is None and not orders.yes:
        raise ConfigError("--fix" if orders.fix else "--restore", notice("doctor.no_terminal"))


def _choose_visit(config: Config, orders: DoctorOrders) -> Visit:
    """Choose MAVLink where the link has an autopilot, else the board's own port."""
    if not config.link.has_autopilot:
        return BoardVisit(config, orders.board)
    if orders.board is not None:
        raise ConfigError("--board", notice("doctor.board_idle"))
    return MavlinkVisit(config)


def _ensure_each_once(wanted: list[Setting]) -> None:
    """Refuse two values for one parameter: nobody could tell which one was meant."""
    names = [parameter.name for parameter in wanted]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError("--fix", notice("doctor.twice", name=name))


def _parse_fix(fix: str, visit: Visit) -> Setting:
    """The parameter that ``--fix`` names with the value that it should have."""
    name, equals, text = fix.partition("=")
    rules = {known: advice.rule for advice in visit.advice for known in advice.names}
    if name not in rules:
        raise ConfigError("--fix", notice("value.choice", choices=sorted(rules), found=name))
    if name not in visit.parameters:
        raise ConfigError("--fix", notice("doctor.absent", autopilot=visit.autopilot, name=name))
    old, rule = visit.parameters[name], rules[name]
    try:
        value = (
            rule.better(old.value)
            if not equals
            else parse_number(text)
            if isinstance(old.value, float)
            else text
        )
    except ValueError:
        raise ConfigError("--fix", notice("doctor.no_number", name=name, text=text)) from None
    if not rule.accepts(value):
        raise ConfigError(
            "--fix",
            notice("doctor.not_accepted", name=name, accepted=rule.words, value=show(value)),
        )
    if not equals and rule.accepts(old.value):
        raise ConfigError("--fix", notice("doctor.fine", name=name, value=show(old.value)))
    return old._replace(value=value)


async def _find_old(visit: Visit, kept: Restore) -> Setting:
    """The parameter of an earlier fix, where it belongs to this vehicle."""
    if kept.autopilot != visit.autopilot or kept.system != visit.system:
        raise ConfigError(
            "--restore",
            notice(
                "doctor.other_vehicle",
                autopilot=kept.autopilot,
                system=kept.system,
                found=visit.autopilot,
                found_system=visit.system,
            ),
        )
    found = await visit.read([kept.name])
    if kept.name not in found or found[kept.name].kind != kept.kind:
        raise ConfigError(
            "--restore", notice("doctor.other_kind", autopilot=visit.autopilot, name=kept.name)
        )
    visit.parameters[kept.name] = found[kept.name]
    return kept.parameter


async def _set(
    visit: Visit, wanted: Setting, config: Config, orders: DoctorOrders, ask: Ask | None
) -> _Fix | None:
    """Set it once the operator has typed its name, its old value being kept.

    None where he has not.
    """
    old = visit.parameters[wanted.name]
    if not orders.yes:
        assert ask is not None, "checked before"
        question = notice(
            "doctor.confirm",
            autopilot=visit.autopilot,
            vehicle=config.vehicle.name,
            name=wanted.name,
            old=show(old.value),
            new=show(wanted.value),
        )
        if (await ask(question.text)).strip() != wanted.name:
            print(
                f"groundstation: doctor: {notice('doctor.unchanged', name=wanted.name)}",
                file=sys.stderr,
            )
            return None
    kept = Restore(
        vehicle=config.vehicle.name,
        autopilot=visit.autopilot,
        system=visit.system,
        name=old.name,
        value=old.value,
        kind=old.kind,
    )
    with refuse_io("--fix", "file.old_value_unwritten", orders.folder.resolve()):
        orders.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        path = save_restore(kept, orders.folder)
    try:
        now = await visit.set(wanted)
    except ValueError as error:
        raise ConfigError("--fix", notice("value.refused", value=wanted.name, why=error)) from None
    return _Fix(old.name, old.value, now.value, str(path.absolute()))


def _format_result(
    visit: Visit,
    findings: list[ParameterFinding],
    fixed: list[_Fix],
    config: Config,
    orders: DoctorOrders,
) -> str:
    if orders.as_json:
        facts: dict[str, Any] = {
            "vehicle": config.vehicle.name,
            "autopilot": visit.autopilot,
            "system": visit.system,
            "healthy": not is_wrong(findings),
            "fixed": [fix._asdict() for fix in fixed],
            "findings": msgspec.to_builtins(findings),
        }
        return json.dumps(facts)
    title = f"{config.vehicle.name}: {visit.autopilot}, system {visit.system}"
    return doctor_report(title, findings, orders.command)


def _describe_undo(fix: _Fix, orders: DoctorOrders) -> str:
    done = notice("doctor.fixed", name=fix.name, old=show(fix.old), new=show(fix.new))
    return f"{done}\n{notice('doctor.undo', command=orders.command, path=shlex.quote(fix.saved))}\n"
