"""The simulated radio: pacer, receiver and bridge at exact instants."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.radio.inline_pacer import MODULE, WirePort
    from sim.radio.pty_wire import PtyWire
    from sim.radio.radio import FAILSAFE_S, RfPeer, RfReceiver, module, section, wires

_MODULES = {
    "inline_pacer": ("MODULE", "WirePort"),
    "pty_wire": ("PtyWire",),
    "radio": ("FAILSAFE_S", "RfPeer", "RfReceiver", "module", "section", "wires"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
