"""The required test with the propellers off, as a guided command: `groundstation props-off`."""
