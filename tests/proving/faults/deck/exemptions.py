"""What can't be asked of a vehicle after a fault, in a closed list of words; everything else is asked of all."""

from enum import StrEnum


class Exemption(StrEnum):
    """Why some limits do not hold for a row; empty where all do."""

    NONE = ""
    NO_LINK = "no link"
    NO_MOTORS = "no motors"
    WEAK = "weak rotors"
    NOT_OBSERVABLE = "not observable"


FALLS = (Exemption.NO_LINK, Exemption.NO_MOTORS, Exemption.WEAK)
"""Nothing that anybody could tell the vehicle holds it up."""
TUMBLES = (Exemption.NO_LINK, Exemption.NO_MOTORS)
"""Nor upright."""

REASONS: dict[Exemption, str] = {
    Exemption.NO_LINK: (
        "the radio module's plug is out: no command reaches the vehicle any more, and its receiver holds the last "
        "frame for 1 s and stops the motors; distance sideways, lean, speed and touchdown are not judged"
    ),
    Exemption.NO_MOTORS: (
        "the autopilot restarts, which stops the motors: it falls whatever anybody does; "
        "lean, speed and touchdown are not judged"
    ),
    Exemption.WEAK: (
        "the rotors at their fullest give less than weight and wind pull: nobody could land it softly; "
        "speed and touchdown are not judged"
    ),
    Exemption.NOT_OBSERVABLE: (
        "poses alone can't tell it from a true flight; the row is judged as it is 5 s after the strike, or after "
        "lift-off. What bounds it: telemetry that knows its own velocity, the fence, and the flight's time"
    ),
}
"""Where each holds, and which limits it lifts."""
