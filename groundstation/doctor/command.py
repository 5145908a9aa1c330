"""What ``groundstation doctor`` does: examine, and on request set one parameter or put an old one back."""

import json
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from groundstation.config import ConfigError
from groundstation.doctor import restore
from groundstation.doctor.advice import Finding, is_wrong
from groundstation.doctor.text import report
from groundstation.doctor.visit import Visit
from groundstation.settings import Config
from links.mavlink_parameters import Parameter
from links.port import LinkError

EXIT_HEALTHY, EXIT_FINDINGS, EXIT_NO_ANSWER = 0, 1, 3

Ask = Callable[[str], Awaitable[str]]


class Orders(NamedTuple):
    """What the operator wants."""

    command: str
    """How this command was called, to be shown with ``--fix``."""
    fix: str | None = None
    """``NAME`` or ``NAME=VALUE``."""
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
    if orders.yes and orders.fix is None and orders.restore is None:
        raise ConfigError("--yes", "it needs the one parameter that it confirms: --fix NAME")
    if orders.fix is not None and orders.restore is not None:
        raise ConfigError("--restore", "one parameter at a time: leave out --fix")
    if (orders.fix or orders.restore) and ask is None and not orders.yes:
        raise ConfigError("--fix", "without a terminal, confirm with --yes")
    kept = _kept(orders.restore) if orders.restore is not None else None
    visit = Visit(config)
    try:
        await visit.open()
        findings = await visit.examine()
        fixed = None
        if orders.fix is not None or kept is not None:
            wanted = await _old(visit, kept) if kept is not None else _wanted(orders.fix or "", visit)
            fixed = await _set(visit, wanted, config, orders, ask)
            if fixed is None:
                return EXIT_FINDINGS
            findings = await visit.examine()
        say(_told(visit, findings, fixed, config, orders))
    except LinkError as error:
        print(f"groundstation: doctor: {error}", file=sys.stderr)
        return EXIT_NO_ANSWER
    finally:
        visit.close()
    return EXIT_FINDINGS if is_wrong(findings) else EXIT_HEALTHY


def _kept(path: Path) -> restore.Restore:
    try:
        return restore.load(path)
    except ValueError as error:
        raise ConfigError("--restore", str(error)) from None


def _wanted(fix: str, visit: Visit) -> Parameter:
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


async def _old(visit: Visit, kept: restore.Restore) -> Parameter:
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


async def _set(visit: Visit, wanted: Parameter, config: Config, orders: Orders, ask: Ask | None) -> _Fix | None:
    """Set it once the operator has typed its name, its old value being kept; None where he has not."""
    old = visit.parameters[wanted.name]
    if not orders.yes:
        assert ask is not None, "checked before"
        what = (
            f"{visit.autopilot} of {config.vehicle.name}: {wanted.name} is {old.value:g} and becomes {wanted.value:g}"
        )
        if (await ask(f"{what}.\nType {wanted.name} to set it, anything else to stop: ")).strip() != wanted.name:
            print("groundstation: doctor: nothing was changed", file=sys.stderr)
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
        path = restore.save(kept, orders.folder)
    except OSError as error:
        raise ConfigError(
            "--fix", f"cannot keep the old value in {orders.folder.resolve()}: {error.strerror}"
        ) from None
    try:
        now = await visit.set(wanted)
    except ValueError as error:
        raise ConfigError("--fix", f"{wanted.name}: {error}") from None
    return _Fix(old.name, old.value, now.value, str(path))


def _told(visit: Visit, findings: list[Finding], fixed: _Fix | None, config: Config, orders: Orders) -> str:
    if orders.as_json:
        facts: dict[str, Any] = {
            "vehicle": config.vehicle.name,
            "autopilot": visit.autopilot,
            "system": visit.facts.target_system,
            "healthy": not is_wrong(findings),
            "fixed": None if fixed is None else fixed._asdict(),
            "findings": msgspec.to_builtins(findings),
        }
        return json.dumps(facts)
    text = report(
        f"{config.vehicle.name}: {visit.autopilot}, system {visit.facts.target_system}", findings, orders.command
    )
    if fixed is None:
        return text
    return (
        f"{fixed.name}: {fixed.old:g} became {fixed.new:g}, read back from the autopilot.\n"
        f"To take it back: {orders.command} --restore {fixed.saved}\n\n{text}"
    )
