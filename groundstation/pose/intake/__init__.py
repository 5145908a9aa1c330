"""What every pose source shares: checks, clocks, datagrams, playback."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.pose.intake.datagram import DatagramSource, cannot_listen
    from groundstation.pose.intake.intake import FrameCount, Intake, Reader
    from groundstation.pose.intake.multicast import join, send_by

_MODULES = {
    "datagram": ("DatagramSource", "cannot_listen"),
    "intake": ("FrameCount", "Intake", "Reader"),
    "multicast": ("join", "send_by"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
