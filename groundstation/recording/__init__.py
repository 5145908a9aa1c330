"""The flight recorder: what a flight hands over (records), what stands in the file (channels), and who writes it.

    RecordedFlight, Wires → records → FlightLog → NAME.mcap, NAME.tlog

In real time the records cross a pipe into a process of its own (process.py, __main__.py); in virtual time they go to
the file at once. Nothing here is imported before somebody records or reads.
"""
