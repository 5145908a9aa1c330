"""The commands of `groundstation-sim`."""

from sim.cli.arguments import MEASUREMENTS, count, names, percent, seconds, whole
from sim.cli.console import ProgressBar
