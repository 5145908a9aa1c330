"""The simulated radio: pacer, receiver and bridge at exact instants."""

from sim.radio.radio import (
    FAILSAFE_S,
    MODULE,
    Failsafe,
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
