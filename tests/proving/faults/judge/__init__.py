"""The judges of a fault: by the truth, by thrust, by the bytes that left."""
