"""The required test with the propellers off, as a guided command: `groundstation props-off`.

    command.py (lock, terminal) → steps.py (what is asked and measured) → process.py → hand.py (holds it armed, idling)

The hand is a process of its own, so that it can be killed, and so that it disarms when whoever guides it dies. What was
proven is kept by groundstation/proof.py, where pre-flight looks for it.
"""
