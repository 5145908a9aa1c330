"""The commands of `groundstation-sim`."""

from sim.cli.arguments import count, names, whole
from sim.cli.console import ProgressBar, summary, typed_command
