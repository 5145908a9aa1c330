"""A systemd unit for the daemon of one configuration. docs/how-to/run-as-a-service.md explains its lines."""

import shlex
import sys
from pathlib import Path
from string import Template

from groundstation.core.safety import CERTAIN_S
from groundstation.flight import DISARM_WAIT_S, examine_trajectory
from groundstation.recording import END_S
from groundstation.settings import Config
from links.core import make_child_command

STOPPING_S = 5.0
"""To come to rest, from the fastest that a flight goes [s]."""
RESERVE = 1.5
"""The longest landing is reckoned so much longer than its figures say."""
BRING_DOWN_S = 15.0
"""Should the landing fail, the link's bring-down follows [s]."""


def longest_landing_s(config: Config) -> float:
    """From SIGTERM to the end of the process, at most, for what this configuration can fly [s].

    From the top of the fence, or else the highest point that it flies to, at the speeds of the landing.
    """
    floor = config.flight.floor_z_m
    top = max(floor - examine_trajectory(config).lowest_ned[2], config.takeoff.height_m)
    if config.fence is not None:
        top = max(top, config.fence.height_m)
    landing = config.landing
    slow = min(landing.touchdown_m_s, config.flight.descent_m_s)
    sinking_s = top / config.flight.descent_m_s + landing.approach_m / slow
    return RESERVE * (STOPPING_S + sinking_s + CERTAIN_S) + DISARM_WAIT_S + BRING_DOWN_S + END_S


def unit(config: Config, path: Path, overrides: list[str], *, user: str) -> str:
    """The unit file's text; ``path`` is the configuration's, ``overrides`` as on the command line."""
    sets = [word for override in overrides for word in ("--set", override)]
    words = [*_program(), "daemon", str(path.resolve()), *sets, "--log-format", "logfmt"]
    command = shlex.join(words).replace("%", "%%").replace("$", "$$")
    landing_s = longest_landing_s(config)
    text = Template((Path(__file__).parent / "groundstation.service").read_text("utf-8"))
    return text.substitute(
        vehicle=config.vehicle.name, command=command, user=user, stop_s=f"{landing_s:.0f}", landing_s=f"{landing_s:.0f}"
    )


def _program() -> list[str]:
    """This very installation, not whatever a path leads to."""
    script = Path(sys.executable).with_name("groundstation")
    return [str(script)] if script.exists() else make_child_command("groundstation")
