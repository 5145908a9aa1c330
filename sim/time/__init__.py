"""Virtual time: an event loop whose clock jumps, with datagrams and streams in memory."""
