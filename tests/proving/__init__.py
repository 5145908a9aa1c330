"""Proofs that no laboratory needs: faults, fuzzing, false alarms, long runs, measurements."""
