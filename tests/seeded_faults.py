"""Forty faults of one line each, and whether the tests catch them:
``python -m tests.seeded_faults [NUMBER ...]``.

Each is put into a copy of the checkout. First run the tests that concern the file; where they let
it pass, with ``--all`` everything that computes. What ``make test`` leaves to ``make test-all`` is
left out here, too, unless ``--long`` is given. Not part of any `make` target: it takes minutes.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("groundstation", "links", "sim")


class Fault(NamedTuple):
    """One line, and what a slip would make of it."""

    file: str
    """Name of the file, wherever it is; the one that holds the line."""
    right: str
    wrong: str


CONCERNED = {
    "deadman.py": "unit/links/core/test_deadman.py unit/links/rf/test_pacer.py "
    "unit/links/mavlink/test_mavlink_link.py",
    "guards.py": "unit/groundstation/core/safety/test_guards.py flight/test_guards.py",
    "pacer.py": "unit/links/rf/test_pacer.py unit/links/mavlink/test_sleep.py "
    "unit/links/rf/test_rf_link.py flight/test_pacer_strikes.py",
    "intake.py": "unit/groundstation/pose/sources/test_gate.py "
    "unit/groundstation/pose/sources/test_source_clock.py flight/test_gate.py",
    "mission.py": "unit/groundstation/core/mission/test_mission.py flight/test_missions.py "
    "flight/test_ends.py",
    "backstepping.py": "property/test_law.py",
    "adaptive.py": "unit/groundstation/core/control/test_look_ahead.py "
    "property/test_composite_proof.py contract/test_controllers.py",
    "demand_limits.py": "property/test_demand_limits.py",
    "protocol/codec.py": "unit/links/mavlink/test_mavlink_codec.py property/test_codecs.py",
    "protocol/senders.py": "unit/links/mavlink/test_mavlink_senders.py",
    "protocol/signing.py": "unit/links/mavlink/test_mavlink_signing.py",
    "module_codec.py": "unit/links/rf/test_rf_codecs.py property/test_codecs.py",
    "vicon_codec.py": "unit/groundstation/pose/sources/test_pose_codecs.py property/test_codecs.py",
    "bridge/codec.py": "unit/links/bridge/test_bridge.py",
    "natnet_codec.py": "unit/groundstation/pose/sources/test_servers.py "
    "unit/groundstation/pose/sources/test_pose_codecs.py",
}
"""The tests that are about a file."""

FAULTS = (
    Fault("deadman.py", "if self.held or opens not in", "if opens not in"),
    Fault("deadman.py", " or now_s > command.deadline_s:", ":"),
    Fault("deadman.py", "command.pose_time_s < newest.pose_time_s", "command.pose_time_s > newest.pose_time_s"),
    Fault("deadman.py", "if now_s <= self.command.deadline_s:", "if now_s <= self.command.deadline_s + 0.1:"),
    Fault("deadman.py", "DEADLINE_LIMIT_S = 1.1", "DEADLINE_LIMIT_S = 11.0"),
    Fault("deadman.py", "            if now_s <= end:\n", "            if now_s <= end + 0.2:\n"),
    Fault("deadman.py", "self.held = False\n        self.command = None\n", "self.held = False\n"),
    Fault("guards.py", "None if depth <= UNDER_FLOOR_M", "None if depth <= 2.0 * UNDER_FLOOR_M"),
    Fault("guards.py", "None if tilt <= v.config.tilt_deg", "None if tilt <= 2.0 * v.config.tilt_deg"),
    Fault("guards.py", "if rtt is None or rtt <= limit", "if rtt is None or rtt <= 5.0 * limit"),
    Fault("guards.py", "share is None or not share < limit", "share is None or not share > limit"),
    Fault("guards.py", "return max(\n            (one for one in found", "return min(\n            (one for one in found"),
    Fault("guards.py", "now_s - left_s > LATE_PERIODS", "now_s - left_s > 10.0 * LATE_PERIODS"),
    Fault("guards.py", "any(\n        abs(rate) >= AT_LIMIT", "all(\n        abs(rate) >= AT_LIMIT"),
    Fault("pacer.py", "if arming == self._arming.number:", "if arming <= self._arming.number:"),
    Fault("pacer.py", "self._deadman.stop()  # no command has come", "pass  # no command has come"),
    Fault("pacer.py", "case Arm(number, at_s) if self._deadman.phase(now_s) is Phase.OVER:", "case Arm(number, at_s):"),
    Fault("pacer.py", "window.high_s + self._config.arm_high_s", "window.high_s"),
    Fault("pacer.py", '_deadman.stop()\n        self._port.lose(', '_port.lose('),
    Fault("pacer.py", "self._deadman.hold()\n        self._quiet_since_s", "self._quiet_since_s"),
    Fault("pacer.py", "self._deadman.stop()\n        self.prepare(now_s)", "self.prepare(now_s)"),
    Fault("intake.py", "if not 0.8 < square < 1.2:", "if not 0.0 < square < 10.0:"),
    Fault("intake.py", "if elapsed <= 0.0:", "if elapsed < -1.0:"),
    Fault("intake.py", "TURN_DEG + config.rate_deg_s * elapsed", "TURN_DEG + 10.0 * config.rate_deg_s * elapsed"),
    Fault("intake.py", ">= self._config.settle_s:", ">= 0.1 * self._config.settle_s:"),
    Fault("intake.py", "if upright < self._cos_tilt:", "if upright < self._cos_tilt - 1.0:"),
    Fault("mission.py", "table[state, Event.KILL] = State.KILLED",
          "table[state, Event.KILL] = state if over else State.KILLED"),
    Fault("mission.py", "(State.TAKEOFF, Event.CLIMBED): State.HOLD,",
          "(State.TAKEOFF, Event.CLIMBED): State.TRACKING,"),
    Fault("mission.py", "table[State.DESCENT, Event.LAND] = State.DESCENT",
          "table[State.DESCENT, Event.LAND] = State.LANDING"),
    Fault("mission.py", "(State.RETURNING, Event.HOME): State.LANDING,", "(State.RETURNING, Event.HOME): State.HOLD,"),
    Fault("backstepping.py", "u_star = -i * (q * a + s1 * x2)", "u_star = -i * (q * a - s1 * x2)"),
    Fault("backstepping.py", "        -(mass / thrust) * y2,", "        (mass / thrust) * y2,"),
    Fault("backstepping.py", "ops.where(suspended, 0.0, law.kb)", "ops.where(suspended, law.kb, law.kb)"),
    Fault("adaptive.py", "add_scaled(b_hat, interval_s, step.b_hat_dot)", "add_scaled(b_hat, -interval_s, step.b_hat_dot)"),
    Fault("demand_limits.py", "p, q, r = clamp(x, -a, a), clamp(y, -b, b), clamp(z, -c, c)", "p, q, r = x, y, z"),
    Fault("protocol/codec.py", "    IGNORE_ATTITUDE = 128", "    IGNORE_ATTITUDE = 0"),
    Fault("protocol/senders.py", "return len(ids) == 1 and ids ==", "return ids =="),
    Fault("protocol/signing.py", "if stamp <= newest:", "if stamp < newest:"),
    Fault("module_codec.py", "CrsfCount.LARGEST) << (11 * i)", "CrsfCount.LARGEST) << (10 * i)"),
    Fault("vicon_codec.py", "return (x / 1000.0, y / 1000.0, z / 1000.0)",
          "return (x / 1000.0, y / 1000.0, z / 100.0)"),
    Fault("bridge/codec.py", "if counter <= self.counter:", "if counter < self.counter:"),
    Fault("natnet_codec.py", "error, bool(flags & BodyFlag.TRACKED))", "error, True)"),
)  # fmt: skip


def copy_checkout(folder: Path) -> None:
    """Into ``folder``, which is made: what is in the checkout, but not what was made by it."""

    def leave_out(at: str, names: list[str]) -> set[str]:
        made = {"runs", "build"} if Path(at) == ROOT else set()
        return {
            name for name in names if name in made or name.startswith(".") or name == "__pycache__"
        }

    shutil.copytree(ROOT, folder, ignore=leave_out)


def file_of(folder: Path, fault: Fault) -> Path:
    """The file of the checkout in ``folder`` that has the line.

    Raises:
        ValueError: not exactly one file of that name has the line, or not exactly once.
    """
    named = [file for package in PACKAGES for file in (folder / package).rglob(fault.file)]
    found = [file for file in named if fault.right in file.read_text("utf-8")]
    if len(found) != 1 or found[0].read_text("utf-8").count(fault.right) != 1:
        raise ValueError(
            f"{fault.file}: {fault.right!r} is to be changed in one place, and stands in {found}"
        )
    return found[0]


def catches(folder: Path, tests: list[str], chosen: str) -> str:
    """The first test that fails in ``folder``; empty where all pass.

    Raises:
        RuntimeError: the tests did not run.
    """
    words = "-q -x --tb=no -p no:cacheprovider -p no:xdist --hypothesis-profile quick -m"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words.split(), chosen, *tests],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == 0:
        return ""
    # What has no test's name could not be read: no test has seen anything.
    lines = (line for line in done.stdout.splitlines() if "::" in line)
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    if not failed:
        raise RuntimeError(done.stdout + done.stderr)
    return failed[0].partition(" - ")[0]


def main() -> int:
    """Seed each fault and tell what caught it."""
    words = argparse.ArgumentParser(description=__doc__)
    numbers = f"0 to {len(FAULTS) - 1}; none means all"
    words.add_argument("numbers", nargs="*", type=int, metavar="NUMBER", help=numbers)
    words.add_argument(
        "--all", action="store_true", help="what the concerned tests let pass goes through all"
    )
    words.add_argument("--long", action="store_true", help="with what `make test-all` adds")
    args = words.parse_args()
    chosen = "not (real_time or soak)" if args.long else "not (real_time or matrix or soak)"
    escaped = []
    for number in args.numbers or range(len(FAULTS)):
        fault = FAULTS[number]
        with tempfile.TemporaryDirectory(prefix="seeded-") as name:
            folder = Path(name) / "checkout"
            copy_checkout(folder)
            file = file_of(folder, fault)
            file.write_text(file.read_text("utf-8").replace(fault.right, fault.wrong), "utf-8")
            tests = [f"tests/{test}" for test in CONCERNED[fault.file].split()]
            by = catches(folder, tests, chosen)
            if args.all and not by:
                by = catches(folder, ["tests"], chosen)
        print(
            f"{number:2} {fault.file:18} {fault.wrong.strip()[:50]!r:54} {by or 'ESCAPED'}",
            flush=True,
        )
        if not by:
            escaped.append(number)
    count = len(args.numbers or FAULTS)
    print(f"{count - len(escaped)} of {count} caught; escaped: {escaped}")
    return len(escaped) > 0


if __name__ == "__main__":
    sys.exit(main())
