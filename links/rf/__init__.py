"""The serial RF link: a transmitter module, whose frames a process of its own paces."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.rf.link import SerialRfLink
    from links.rf.paced_link import PacedLink
    from links.rf.pacer import FramePacer
    from links.rf.pacer_messages import Arm, End, Give, Hear, OpenPacer, Order, Pacer, Report, Serve, Stop
    from links.rf.pacer_process import open_process
    from links.rf.standby_watch import LOOK_S, Watch

_MODULES = {
    "link": ("SerialRfLink",),
    "paced_link": ("PacedLink",),
    "pacer": ("FramePacer",),
    "pacer_messages": ("Arm", "End", "Give", "Hear", "OpenPacer", "Order", "Pacer", "Report", "Serve", "Stop"),
    "pacer_process": ("open_process",),
    "standby_watch": ("LOOK_S", "Watch"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
