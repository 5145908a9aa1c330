"""What only proves, and no laboratory needs: faults, fuzzing, false alarms, long runs, measurements."""
