"""The simulated radio: pacer, receiver and bridge at exact instants."""
