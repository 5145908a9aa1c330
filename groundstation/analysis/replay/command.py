"""``groundstation replay LOG.mcap``: a recorded flight flown again, from the wire up."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError, from_dict, parse_toml
from groundstation.core.control import Custom
from groundstation.recording import NoRecording, Recording
from groundstation.settings import Config

NAMES = ("thrust_n", "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")


FLOWN_AGAIN = ("vehicle", "controller", "pose", "gate", "link", "flight")
"""Tables of the configuration that a replay asks; the reference, and what the mission did, are as recorded."""
END = "this is all that is in it"


def replay_command(path: Path, overrides: Sequence[str], *, as_json: bool, trust_modules: bool = False) -> int:
    """Fly ``path`` again, with ``overrides`` where given; print what came of it.

    Returns 0, or 1 where the recording is damaged, or nothing was changed and the commands are not the same to the last
    bit.

    Raises:
        ConfigError: the file is no recording, an override is bad, or it was flown by a controller of somebody's own,
            whose module nobody has said to be trusted.
    """
    facts = replayed(path, overrides, trust_modules=trust_modules)
    print(json.dumps(facts) if as_json else text_of(facts))
    return 0 if facts["damaged_at"] is None and (overrides or facts["identical"]) else 1


def replayed(path: Path, overrides: Sequence[str] = (), *, trust_modules: bool = False) -> dict[str, Any]:
    """The object that ``--json`` prints.

    Raises:
        ConfigError: see :func:`replay_command`.
    """
    from groundstation.analysis.replay.again import fly_again
    from groundstation.recording import About
    from groundstation.recording import facts as program

    try:
        recording = Recording(path)
        config = _config(recording, overrides)
        if not trust_modules and not any(map(_names_controller, overrides)):
            _ensure_own(config, path)
        result = fly_again(recording, config)
    except NoRecording as error:
        raise ConfigError("LOG", str(error)) from None
    except OSError as error:
        raise ConfigError("LOG", f"cannot read {path}: {error.strerror}") from None
    own = program(About(config="", vehicle="", controller="", trajectory="", period_s=0.0))
    nothing_differs = not any(result.differing.values())
    count = len(result.commands)
    return {
        "file": str(path),
        "identical": nothing_differs and not result.lost and count + result.idle > 0,
        "first_difference": None if result.first is None else msgspec.to_builtins(result.first),
        "commands": count,
        "idle_commands": result.idle,
        "poses": result.poses,
        "differing": result.differing,
        "lost": result.lost,
        "unheard_wires": result.deaf,
        "whole": recording.whole,
        "damaged_at": recording.damaged_at,
        "overrides": list(overrides),
        "without_effect": [override for override in overrides if _table(override) not in FLOWN_AGAIN],
        "changes": {name: _change([(p.recorded[i], p.replayed[i]) for p in result.commands]) for i, name in _indexed()},
        "saturated_fraction": sum(pair.saturated for pair in result.commands) / count if count else None,
        "recorded_by": {key: recording.about.get(key, "") for key in ("version", "git", "python")},
        "replayed_by": {key: own[key] for key in ("version", "git", "python")},
    }


def _config(recording: Recording, overrides: Sequence[str]) -> Config:
    try:
        told = parse_toml(recording.about.get("config", ""))
    except ValueError as error:
        raise ConfigError("", f"the configuration in it is {error}", str(recording.path)) from None
    return from_dict(told, Config, overrides, source=str(recording.path))


def _names_controller(override: str) -> bool:
    return override.partition("=")[0].strip() in ("controller.kind", "controller.factory")


def _ensure_own(config: Config, path: Path) -> None:
    """Let no recording choose what code runs here: whoever has made it may have meant any.

    Raises:
        ConfigError: it names a module.
    """
    if isinstance(config.controller, Custom):
        raise ConfigError(
            "controller.kind",
            f"flown by {config.controller.factory}: to replay it, that module is imported here, and its code runs. "
            "Where you trust it, say --trust-modules; or fly your own: --set controller.factory=package.module:factory",
            str(path),
        )


def _table(override: str) -> str:
    return override.partition("=")[0].strip().partition(".")[0]


def _indexed() -> list[tuple[int, str]]:
    return list(enumerate(NAMES))


def _change(pairs: list[tuple[float, float]]) -> dict[str, float] | None:
    """How far the numbers made anew are from the recorded ones; None without any."""
    if not pairs:
        return None
    steps = [abs(b - a) for a, b in pairs]
    return {
        "rms": (sum(step * step for step in steps) / len(steps)) ** 0.5,
        "max": max(steps),
        "recorded_mean": sum(a for a, _ in pairs) / len(pairs),
        "replayed_mean": sum(b for _, b in pairs) / len(pairs),
    }


def text_of(facts: dict[str, Any]) -> str:
    """The same for people."""
    lines = [
        f"{facts['file']}: {facts['commands']} commands, {facts['idle_commands']} idle ones, {facts['poses']} poses"
        + ("" if facts["whole"] else f"; the recording was cut off, {END}" if facts["damaged_at"] is None else "")
    ]
    if facts["damaged_at"] is not None:
        lines.append(f"DAMAGED at byte {facts['damaged_at']}: the rest is not read, {END}")
    if facts["lost"]:
        lines.append(f"{facts['lost']} records are missing: the recorder could not keep up")
    if facts["differing"]["pose"]:
        lines += [
            f"nobody listens on {wire} this time: what was heard there is left out" for wire in facts["unheard_wires"]
        ]
    first = facts["first_difference"]
    if facts["identical"]:
        there = "" if facts["damaged_at"] is None else " before the damage"
        lines.append(f"identical: every pose and every command{there} is the same to the last bit")
    elif first is not None:
        lines.append(
            f"not identical: {facts['differing']['command']} commands differ, first {first['what']} "
            f"{first['number']} at {first['time_s']:.6f} s, {first['field']}: "
            f"{first['recorded']} recorded, {first['replayed']} now"
        )
    if facts["without_effect"]:
        lines.append(
            f"{', '.join(facts['without_effect'])}: changes nothing here. The reference is the recorded one, and only "
            "pose source, gate, estimator and controller run again; to fly it otherwise, use the simulator"
        )
    if facts["overrides"]:
        lines += ["", f"with {', '.join(facts['overrides'])}, on the poses that were seen (nothing flies differently):"]
    if not facts["identical"] and facts["commands"]:
        lines.append(f"{'':20}{'mean recorded':>15}{'mean now':>12}{'change RMS':>12}{'largest':>12}")
        for name in NAMES:
            c = facts["changes"][name]
            lines.append(
                f"{name:20}{c['recorded_mean']:>15.4f}{c['replayed_mean']:>12.4f}{c['rms']:>12.4f}{c['max']:>12.4f}"
            )
        lines.append(f"{'at a limit':20}{'':>15}{100.0 * facts['saturated_fraction']:>10.1f} %")
    if not facts["identical"] and not facts["overrides"] and facts["recorded_by"] != facts["replayed_by"]:
        lines.append(f"recorded by {_said(facts['recorded_by'])}, replayed by {_said(facts['replayed_by'])}")
    return "\n".join(lines)


def _said(program: dict[str, str]) -> str:
    return f"version {program['version']} ({program['git'][:12] or 'no commit'}) on Python {program['python']}"
