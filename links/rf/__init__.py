"""The serial RF link: a transmitter module, whose frames a process of its own paces."""
