"""Units that people read: milliseconds, millimetres, centimetres and percent of SI values.

Sans-IO.
"""


def to_ms(time_s: float) -> float:
    """Convert seconds to milliseconds."""
    return 1e3 * time_s


def to_mm(length_m: float) -> float:
    """Convert metres to millimetres."""
    return 1e3 * length_m


def to_cm(length_m: float) -> float:
    """Convert metres to centimetres."""
    return 100.0 * length_m


def to_percent(share: float) -> float:
    """Convert a share of 1 to percent."""
    return 100.0 * share
