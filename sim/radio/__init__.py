"""The simulated radio: pacer, receiver and bridge at exact instants."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.radio.radio import (
        FAILSAFE_S,
        MODULE,
        Failsafe,
        InlinePacer,
        PtyWire,
        PulseReceiver,
        Receiver,
        RfPeer,
        RfReceiver,
        WirePort,
        bridge_to,
        module,
        section,
        wires,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
