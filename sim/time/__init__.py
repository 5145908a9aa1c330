"""Virtual time: an event loop whose clock jumps, with datagrams and streams in memory."""

from sim.time.virtual_time import Address, VirtualTimeLoop, in_virtual_time
