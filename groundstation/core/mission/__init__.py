"""The mission as a table: state and event to state."""

from groundstation.core.mission.mission import (
    ALARMING,
    EVENT_OF,
    FINAL,
    IN_AIR,
    ON_GROUND,
    TABLE,
    Event,
    Mission,
    State,
)
from groundstation.core.mission.operator import REPEAT_S, HoldToRun, InputLost, Interrupts
