"""The commands of `groundstation-sim`."""

from sim.cli.arguments import MEASUREMENTS, count, hours, names, percent, seconds, whole
from sim.cli.console import ProgressBar
