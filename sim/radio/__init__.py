"""The simulated radio: pacer, receiver and bridge at exact instants."""

from sim.radio import rf_receiver as rf_receiver

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.radio.inline_pacer import MODULE, WirePort
    from sim.radio.pty_wire import PtyWire
    from sim.radio.radio import module, section, wires
    from sim.radio.rf_receiver import FAILSAFE_S, RfPeer

_MODULES = {
    "inline_pacer": ("MODULE", "WirePort"),
    "pty_wire": ("PtyWire",),
    "radio": ("module", "section", "wires"),
    "rf_receiver": ("FAILSAFE_S", "RfPeer"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
