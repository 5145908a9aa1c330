"""The local interface: one JSON object a line on a UNIX socket."""
