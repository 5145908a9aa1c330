"""The commands of `groundstation-sim`."""

from sim.cli.arguments import count, names, whole
from sim.cli.console import ProgressBar, typed_command
