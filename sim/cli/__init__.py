"""The commands of `groundstation-sim`."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.cli.arguments import MEASUREMENTS, count, hours, names, percent, seconds, whole
    from sim.cli.console import ProgressBar


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
