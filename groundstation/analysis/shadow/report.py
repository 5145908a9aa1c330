"""From a .tlog to its report: the steps in order."""

from collections.abc import Sequence
from pathlib import Path

from groundstation.analysis.shadow.facts import Facts, measured
from groundstation.analysis.shadow.flight import hover_share, thrust_shares
from groundstation.analysis.shadow.judge import Check, checks, verdict
from groundstation.analysis.shadow.path import FlownPath
from groundstation.analysis.shadow.recording import read_recording
from groundstation.analysis.shadow.replay import replay
from groundstation.analysis.shadow.vehicle import completed, described, latency_s, mavlink


class Report(Facts, frozen=True, kw_only=True):
    """A replay in numbers, and what to make of them: the object that ``--json`` prints."""

    verdict: str
    """``fit``, ``fit with care`` or ``not fit`` to fly on."""
    reasons: list[str]
    """The sentences that the verdict rests on: every one that is not fine, or all where all are."""
    checks: list[Check]
    """Everything that was looked at."""


def report(file: Path, config_path: Path | None = None, overrides: Sequence[str] = ()) -> Report:
    """Replay ``file``. The same file and configuration give the same report, to the last bit.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    config = described(config_path, overrides)
    recording = read_recording(file, latency_s(config), mavlink(config).target_system)
    path = FlownPath([seen.pose for seen in recording.poses], config.flight.coast_s)
    shares = thrust_shares(recording.sent, config.thrust_curve)
    hover = hover_share(recording, shares, path, config.controller.gravity)
    config = completed(config, config_path, overrides, recording, hover)
    facts = measured(str(file), recording, replay(recording, config, path, hover), path, config, hover)
    looked_at = checks(facts)
    result = verdict(looked_at)
    return Report(
        **{name: getattr(facts, name) for name in Facts.__struct_fields__},
        verdict=result,
        reasons=[check.text for check in looked_at if result == "fit" or check.level != "fine"],
        checks=looked_at,
    )
