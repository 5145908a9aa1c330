"""What ``groundstation doctor`` does: examine, and on request set parameters one by one or put an old one back."""

import json
import shlex
import sys
import textwrap
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from groundstation.config import ConfigError
from groundstation.lab.doctor import restore
from groundstation.lab.doctor.advice import Finding, Weight, is_wrong
from groundstation.lab.doctor.visit import Visit
from groundstation.settings import Config
from links.core import LinkError
from links.mavlink.protocol import AutopilotParameter

_MARKS = {"ok": "ok", "must": "MUST", "should": "SHOULD", "note": "note", "absent": "-"}
_ORDER = list(_MARKS)
WIDTH = 100


def report(title: str, findings: Sequence[Finding], command: str) -> str:
    """The table, the worst first, each that is not right with its reason and the ``command`` that mends it."""
    worst_first = ("must", "should", "ok", "note", "absent")
    lines = [title, "", f"{'':8}{'parameter':17}{'value':>9}  accepted"]
    for finding in sorted(findings, key=lambda f: worst_first.index(f.verdict)):
        value = "-" if finding.value is None else f"{finding.value:g}"
        lines += _wrapped(f"{_MARKS[finding.verdict]:8}{finding.name:17}{value:>9}  ", finding.accepted)
        if finding.verdict in (Weight.MUST, Weight.SHOULD, Weight.NOTE):
            lines += _wrapped(" " * 12, finding.why)
        if finding.recommended is not None:
            lines.append(f"{'':12}set it to {finding.recommended:g}: {command} --fix {finding.name}")
            if finding.reboot:
                lines.append(f"{'':12}(counts after the autopilot was restarted)")
    lines += ["", _summary(findings)]
    return "\n".join(lines)


def _wrapped(begin: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=begin, subsequent_indent=" " * max(len(begin), 12))


def _summary(findings: Sequence[Finding]) -> str:
    counts = {verdict: sum(f.verdict == verdict for f in findings) for verdict in _ORDER}
    absent = f", {counts['absent']} not in this firmware" if counts["absent"] else ""
    if not is_wrong(findings):
        return f"Nothing to change: {counts['ok']} ok, {counts['note']} to be read{absent}."
    return f"{counts['must']} must and {counts['should']} should be changed; {counts['ok']} ok{absent}."


EXIT_HEALTHY, EXIT_FINDINGS, EXIT_NO_ANSWER = 0, 1, 3

Ask = Callable[[str], Awaitable[str]]


class Orders(NamedTuple):
    """What the operator wants."""

    command: str
    """How this command was called, to be shown with ``--fix``."""
    fix: tuple[str, ...] = ()
    """Each ``NAME`` or ``NAME=VALUE``."""
    restore: Path | None = None
    """File of an earlier fix."""
    yes: bool = False
    """Do not ask."""
    as_json: bool = False
    folder: Path = Path()
    """Where old values are kept."""


class _Fix(NamedTuple):
    """One change, and where the old value is kept."""

    name: str
    old: float
    new: float
    saved: str


async def doctor(config: Config, orders: Orders, ask: Ask | None, say: Callable[[str], None] = print) -> int:
    """Visit the autopilot of ``config``; ``ask`` puts a question to the operator, None where nobody is there.

    ``say`` tells what was found.

    Returns 0 where all is as it should be, 1 where something is not or was not confirmed, 3 where the autopilot does
    not answer or refuses.

    Raises:
        ConfigError: the orders make no sense.
    """
    if orders.yes and not orders.fix and orders.restore is None:
        raise ConfigError("--yes", "it needs the one parameter that it confirms: --fix NAME")
    if orders.fix and orders.restore is not None:
        raise ConfigError("--restore", "it puts one parameter back: leave out --fix")
    if (orders.fix or orders.restore) and ask is None and not orders.yes:
        raise ConfigError("--fix", "without a terminal, confirm with --yes")
    kept = _kept(orders.restore) if orders.restore is not None else None
    visit = Visit(config)
    try:
        await visit.open()
        findings = await visit.examine()
        all_wanted = [_wanted(fix, visit) for fix in orders.fix] if kept is None else [await _old(visit, kept)]
        _ensure_each_once(all_wanted)
        fixed: list[_Fix] = []
        for wanted in all_wanted:
            one = await _set(visit, wanted, config, orders, ask)
            if one is None:
                break
            fixed.append(one)
            if not orders.as_json:
                say(_taken_back(one, orders))
        confirmed = len(fixed) == len(all_wanted)
        if all_wanted and not fixed:
            return EXIT_FINDINGS
        if fixed:
            findings = await visit.examine()
        say(_told(visit, findings, fixed, config, orders))
    except LinkError as error:
        print(f"groundstation: doctor: {error}", file=sys.stderr)
        return EXIT_NO_ANSWER
    finally:
        visit.close()
    return EXIT_FINDINGS if is_wrong(findings) or not confirmed else EXIT_HEALTHY


def _ensure_each_once(wanted: list[AutopilotParameter]) -> None:
    """Refuse two values for one parameter: nobody could tell which one was meant.

    Raises:
        ConfigError: a parameter is named twice.
    """
    names = [parameter.name for parameter in wanted]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError("--fix", f"{name} is named twice: say once what it should be")


def _kept(path: Path) -> restore.Restore:
    try:
        return restore.load(path)
    except ValueError as error:
        raise ConfigError("--restore", str(error)) from None


def _wanted(fix: str, visit: Visit) -> AutopilotParameter:
    """The parameter that ``--fix`` names with the value that it should have."""
    name, equals, text = fix.partition("=")
    rules = {known: advice.rule for advice in visit.advice for known in advice.names}
    if name not in rules:
        raise ConfigError("--fix", f"expected one of {sorted(rules)}, got {name!r}")
    if name not in visit.parameters:
        raise ConfigError("--fix", f"this {visit.autopilot} has no parameter {name}")
    old, rule = visit.parameters[name], rules[name]
    try:
        value = float(text) if equals else rule.better(old.value)
    except ValueError:
        raise ConfigError("--fix", f"{name}: expected a number, got {text!r}") from None
    if not rule.accepts(value):
        raise ConfigError("--fix", f"{name}: expected {rule.words}, got {value:g}")
    if not equals and rule.accepts(old.value):
        raise ConfigError("--fix", f"{name} is {old.value:g}, which is fine; to change it anyway say {name}=VALUE")
    return old._replace(value=value)


async def _old(visit: Visit, kept: restore.Restore) -> AutopilotParameter:
    """The parameter of an earlier fix, where it belongs to this vehicle."""
    if kept.autopilot != visit.autopilot or kept.system != visit.facts.target_system:
        raise ConfigError(
            "--restore",
            f"the file is of {kept.autopilot}, system {kept.system}; this is {visit.autopilot}, "
            f"system {visit.facts.target_system}",
        )
    found = await visit.read([kept.name])
    if kept.name not in found or found[kept.name].kind != kept.kind:
        raise ConfigError("--restore", f"this {visit.autopilot} has no parameter {kept.name} of that kind")
    visit.parameters[kept.name] = found[kept.name]
    return kept.parameter


async def _set(
    visit: Visit, wanted: AutopilotParameter, config: Config, orders: Orders, ask: Ask | None
) -> _Fix | None:
    """Set it once the operator has typed its name, its old value being kept; None where he has not."""
    old = visit.parameters[wanted.name]
    if not orders.yes:
        assert ask is not None, "checked before"
        what = (
            f"{visit.autopilot} of {config.vehicle.name}: {wanted.name} is {old.value:g} and becomes {wanted.value:g}"
        )
        if (await ask(f"{what}.\nType {wanted.name} to set it, anything else to stop: ")).strip() != wanted.name:
            print(f"groundstation: doctor: {wanted.name} was not changed", file=sys.stderr)
            return None
    kept = restore.Restore(
        vehicle=config.vehicle.name,
        autopilot=visit.autopilot,
        system=visit.facts.target_system,
        name=old.name,
        value=old.value,
        kind=old.kind,
    )
    try:
        orders.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        path = restore.save(kept, orders.folder)
    except OSError as error:
        raise ConfigError(
            "--fix", f"cannot keep the old value in {orders.folder.resolve()}: {error.strerror}"
        ) from None
    try:
        now = await visit.set(wanted)
    except ValueError as error:
        raise ConfigError("--fix", f"{wanted.name}: {error}") from None
    return _Fix(old.name, old.value, now.value, str(path.absolute()))


def _told(visit: Visit, findings: list[Finding], fixed: list[_Fix], config: Config, orders: Orders) -> str:
    if orders.as_json:
        facts: dict[str, Any] = {
            "vehicle": config.vehicle.name,
            "autopilot": visit.autopilot,
            "system": visit.facts.target_system,
            "healthy": not is_wrong(findings),
            "fixed": [fix._asdict() for fix in fixed],
            "findings": msgspec.to_builtins(findings),
        }
        return json.dumps(facts)
    return report(
        f"{config.vehicle.name}: {visit.autopilot}, system {visit.facts.target_system}", findings, orders.command
    )


def _taken_back(fix: _Fix, orders: Orders) -> str:
    return (
        f"{fix.name}: {fix.old:g} became {fix.new:g}, read back from the autopilot.\n"
        f"To take it back: {orders.command} --restore {shlex.quote(fix.saved)}\n"
    )
