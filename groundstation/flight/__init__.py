"""One flight: command loop, shutdown, statistics."""

from groundstation.flight.assembly import Give, WireTaps, about, make_ends, make_flight, recorder
from groundstation.flight.command_loop import FrameLateness
from groundstation.flight.flight import Flight, FlightOutcome
from groundstation.flight.hold_to_run import HoldWatch, ensure_held, make_hold
from groundstation.flight.step_timer import StepTimeout, StepTimer
